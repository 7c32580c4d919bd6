"""What a sensor's beams meet in the static world: of one that stands still, computed once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import LabelledMesh, SurfaceMaterials
from urbantwin.lidar.beams import Beams
from urbantwin.lidar.casting import EmbreeCaster
from urbantwin.lidar.casting.warp_layers import WarpLayers
from urbantwin.lidar.compiled.order import by_ray
from urbantwin.lidar.layers import SensorPoses, cast_world
from urbantwin.lidar.returns import Scatter, scatter_of_materials
from urbantwin.lidar.shapes import ActorShape, ShapeArrays
from urbantwin.lidar.sweep import Sweep
from urbantwin.taxonomy import GROUND_CLASSES, semantic_id

__all__ = ["StaticHits", "StaticLayers", "World", "cast_static"]


@dataclass(frozen=True, eq=False)
class StaticLayers:
    """Layers of the static world along N beams, those of a beam next to each other.

    Attributes:
        start: (N + 1,) int64, where the layers of each beam begin.
        range_m: (L,) float32.
        backscatter: (L,) float32, see ``returns.scatter``.
        through: (L,) float32, share of the light that passes, to and fro.
        mask: (L,) uint8, which of the beam's rays meet it.
        semantic: (L,) uint16.
        cosine: (L,) float32, of the angles of incidence; ``None``: all are faced squarely.
    """

    start: NDArray[np.int64]
    range_m: NDArray[np.float32]
    backscatter: NDArray[np.float32]
    through: NDArray[np.float32]
    mask: NDArray[np.uint8]
    semantic: NDArray[np.uint16]
    cosine: NDArray[np.float32] | None = None


class World:
    """The static world as rays see it.

    The mesh is moved to ``origin`` in float64 before it becomes float32, so the error near a
    sensor does not grow with its distance from the anchor; ranges are evaluated on the triangles'
    planes in float64.

    Args:
        mesh: the static world, site frame.
        origin: (3,) where its own origin is to be: near the sensors.
        surface: materials of the ground that are finer than the mesh.
        device: where rays are cast; ``None``: on the processor, by Embree.
    """

    def __init__(
        self,
        mesh: LabelledMesh,
        origin: NDArray[np.float64],
        surface: SurfaceMaterials | None = None,
        device: WarpLayers | None = None,
    ) -> None:
        self._mesh, self._surface = mesh, surface
        self._origin = np.array(origin, np.float64)
        moved = LabelledMesh(
            mesh.vertices - self._origin, mesh.faces, mesh.semantic, mesh.material, mesh.part
        )
        self._shape = ActorShape(moved, with_hull=False)
        # Nobody knows the rooms: what goes in through a window is lost, and does not come back
        # from the far side of a hollow building.
        self._shape.panes &= mesh.semantic != semantic_id("building")
        self._arrays = ShapeArrays.of([self._shape], device)
        self._ground = np.isin(mesh.semantic, [semantic_id(name) for name in GROUND_CLASSES])

    def layers(
        self, beams: Beams, sweep: Sweep, poses: SensorPoses, scatter: Scatter, *, thorough: bool
    ) -> StaticLayers:
        """Return what beams meet.

        Args:
            beams: of the sensor.
            sweep: when they fire.
            poses: where the sensor is, site frame.
            scatter: what materials send back.
            thorough: see ``layers.cast_world``.
        """
        here = SensorPoses(poses.rotation, poses.translation - self._origin)
        glass = bool((scatter.through > 0).any())
        met = cast_world(beams, sweep, here, self._arrays, glass=glass, thorough=thorough)
        start, order = by_ray(met.ray, len(beams.directions))
        ray, face = met.ray[order], met.face[order]
        range_m, cosine = met.range_m[order], met.cosine[order]
        material = self._mesh.material[face]
        grain = scatter.grain(ray, face)
        if scatter.texture > 0:
            ground = np.flatnonzero(self._ground.take(face))
            places = _places(beams, poses, ray[ground], range_m[ground])
            grain[ground] *= scatter.patches(places)
        if self._surface is not None and self._surface.layers:
            places = _places(beams, poses, ray, range_m)
            material = self._surface.materials_of(self._mesh, face, places)
        return StaticLayers(
            start,
            range_m,
            scatter.backscatter(material, cosine) * grain,
            scatter.transmission(material, cosine),
            met.mask[order],
            self._mesh.semantic[face],
            cosine,
        )


def _places(
    beams: Beams, poses: SensorPoses, ray: NDArray[np.int32], range_m: NDArray[np.float32]
) -> NDArray[np.float64]:
    """Return where beams (N,) are at ranges (N,), in the frame of the poses, (N, 3)."""
    aim = beams.directions[ray]
    if len(poses.translation) == 1:
        aim, place = aim @ poses.rotation[0].T, poses.translation[0]
    else:
        n = ray % beams.columns
        aim = np.einsum("nij,nj->ni", poses.rotation[n], aim)
        place = poses.translation[n]
    return np.asarray(place + aim * range_m[:, None])


@dataclass(frozen=True, eq=False)
class StaticHits:
    """First hits of N thin rays in the static world.

    Attributes:
        range_m: (N,) float32, metres; ``inf`` where a ray hits nothing.
        face: (N,) int32, number of the triangle; -1 where a ray hits nothing.
        cosine: (N,) float32, cosine of the angle between ray and normal, 0..1; 0 without a hit.
        backscatter: (N,) float32, see ``returns.scatter``; 0 without a hit.
        semantic: (N,) uint16, class of the triangle; 0 (unlabelled) without a hit.
    """

    range_m: NDArray[np.float32]
    face: NDArray[np.int32]
    cosine: NDArray[np.float32]
    backscatter: NDArray[np.float32]
    semantic: NDArray[np.uint16]


def cast_static(
    mesh: LabelledMesh,
    origin: NDArray[np.float64],
    directions: NDArray[np.float64],
    *,
    wavelength_nm: float = 905.0,
    surface: SurfaceMaterials | None = None,
) -> StaticHits:
    """Cast thin rays from one place at the static world.

    Args:
        mesh: the static world.
        origin: (3,) where all rays leave, in the mesh's frame.
        directions: (N, 3) unit vectors, in the mesh's frame.
        wavelength_nm: of the laser.
        surface: materials of the ground that are finer than the mesh, where a ray hits it.
    """
    caster = EmbreeCaster(mesh.vertices - origin, mesh.faces)
    found = caster.cast(np.zeros(3), directions.astype(np.float32))
    hit = np.flatnonzero(found.face >= 0)
    face = found.face[hit]
    material = mesh.material[face]
    if surface is not None:
        places = origin + directions[hit] * found.range_m[hit, None].astype(np.float64)
        material = surface.materials_of(mesh, face, places)
    count = len(directions)
    cosine, back = np.zeros(count, np.float32), np.zeros(count, np.float32)
    cosine[hit] = np.abs((mesh.normals()[face] * directions[hit]).sum(axis=1))
    back[hit] = scatter_of_materials(wavelength_nm).backscatter(material, cosine[hit])
    semantic = np.zeros(count, np.uint16)
    semantic[hit] = mesh.semantic[face]
    return StaticHits(found.range_m, found.face, cosine, back, semantic)
