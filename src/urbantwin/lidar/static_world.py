"""The static world as a sensor's beams meet it; computed once for a sensor that stands still."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import LabelledMesh, SurfaceMaterials
from urbantwin.lidar.beams import Beams
from urbantwin.lidar.casting.cast import cast_world
from urbantwin.lidar.casting.tracer import Firing, RayTracer, SensorPoses
from urbantwin.lidar.compiled.order import by_ray
from urbantwin.lidar.compiled.view import places_along
from urbantwin.lidar.returns import ReturnModel
from urbantwin.lidar.shapes import ActorShape, Shapes
from urbantwin.lidar.timing import Sweep
from urbantwin.taxonomy import semantic_id

__all__ = ["StaticLayers", "World"]


class StaticLayers(NamedTuple):
    """Layers of the static world along N beams, those of a beam next to each other.

    Attributes:
        start: (N + 1,) int64, where the layers of each beam begin.
        range_m: (L,) float32.
        backscatter: (L,) float64, see ``returns.scatter``.
        through: (L,) float64, share of the light that passes, to and fro.
        mask: (L,) uint8, which of the beam's rays meet it.
        semantic: (L,) uint16.
        peak: (L,) float32, what is left of the peak of pulses from it, see ``returns.stretch``.
    """

    start: NDArray[np.int64]
    range_m: NDArray[np.float32]
    backscatter: NDArray[np.floating]
    through: NDArray[np.floating]
    mask: NDArray[np.uint8]
    semantic: NDArray[np.uint16]
    peak: NDArray[np.float32]

    @property
    def beam(self) -> NDArray[np.int64]:
        """The beam (L,) of each layer."""
        return np.repeat(np.arange(len(self.start) - 1), np.diff(self.start))

    def filled(
        self,
        kept: NDArray[np.bool_],
        beam: NDArray[np.int64],
        range_m: NDArray[np.float32],
        backscatter: NDArray[np.floating],
        semantic: NDArray[np.uint16],
        rays: int,
    ) -> StaticLayers:
        """Return some of the layers and, for M beams, one opaque surface that fills each.

        Args:
            kept: (L,) which of the layers.
            beam: (M,) that meet something else; it is faced squarely.
            range_m: (M,) where.
            backscatter: (M,) of it.
            semantic: (M,) its class.
            rays: how many a beam is made of.
        """
        number = np.concatenate([self.beam[kept], beam])
        order = np.argsort(number, kind="stable")
        start = np.zeros(len(self.start), np.int64)
        np.cumsum(np.bincount(number, minlength=len(start) - 1), out=start[1:])
        full = np.full(len(beam), (1 << rays) - 1, np.uint8)
        return StaticLayers(
            start,
            np.concatenate([self.range_m[kept], range_m])[order],
            np.concatenate([self.backscatter[kept], backscatter])[order],
            np.concatenate([self.through[kept], np.zeros(len(beam), np.float32)])[order],
            np.concatenate([self.mask[kept], full])[order],
            np.concatenate([self.semantic[kept], semantic])[order],
            np.concatenate([self.peak[kept], np.ones(len(beam), np.float32)])[order],
        )


class World:
    """The static world as rays see it.

    The mesh is moved to ``origin`` in float64 before it becomes float32, so the error near a
    sensor does not grow with its distance from the anchor; ranges are evaluated on the triangles'
    planes in float64.

    Args:
        mesh: the static world, site frame.
        origin: (3,) where its own origin is to be: near the sensors.
        surface: materials of the ground that are finer than the mesh.
        tracer: what casts the rays.
    """

    def __init__(
        self,
        mesh: LabelledMesh,
        origin: NDArray[np.float64],
        surface: SurfaceMaterials | None,
        tracer: RayTracer,
    ) -> None:
        self._mesh, self._surface, self._tracer = mesh, surface, tracer
        self._origin = np.array(origin, np.float64)
        moved = LabelledMesh(
            mesh.vertices - self._origin, mesh.faces, mesh.semantic, mesh.material, mesh.part
        )
        shape = ActorShape(moved, with_hull=False)
        # Rooms are not modelled: what goes in through a window is lost, and does not come back
        # from the far side of a hollow building.
        shape.planes["pane"] &= mesh.semantic != semantic_id("building")
        self._shapes = Shapes.of([shape])
        self._ground = mesh.is_ground

    def layers(
        self, beams: Beams, sweep: Sweep, poses: SensorPoses, model: ReturnModel, *, thorough: bool
    ) -> StaticLayers:
        """Return what beams meet.

        Args:
            beams: of the sensor.
            sweep: when they fire.
            poses: where the sensor is, site frame.
            model: what the sensor makes of echoes.
            thorough: see `casting.cast.cast_world`.
        """
        scatter = model.scatter
        here = SensorPoses(poses.rotation, poses.translation - self._origin)
        met = cast_world(
            self._tracer,
            beams,
            Firing.of(beams, sweep, here),
            self._shapes,
            glass=bool((scatter.through > 0).any()),
            thorough=thorough,
        )
        start, order = by_ray(met.ray, len(beams.directions))
        ray, face = met.ray.take(order), met.face.take(order)
        range_m, cosine = met.range_m.take(order), met.cosine.take(order)
        material = self._mesh.material.take(face)
        grain = scatter.grain(ray, face)
        if scatter.texture > 0 or scatter.swallows:
            ground = np.flatnonzero(self._ground.take(face))
            places = _places(beams, poses, ray[ground], range_m[ground])
            grain[ground] *= scatter.patches(places) * scatter.thrown_on(places, cosine[ground])
        if self._surface is not None and self._surface.layers:
            places = _places(beams, poses, ray, range_m)
            material = self._surface.materials_of(self._mesh, face, places)
        return StaticLayers(
            start,
            range_m,
            scatter.backscatter(material, cosine) * grain,
            scatter.transmission(material, cosine),
            met.mask.take(order),
            self._mesh.semantic.take(face),
            model.peak_left(range_m, cosine),
        )


def _places(
    beams: Beams, poses: SensorPoses, ray: NDArray[np.int32], range_m: NDArray[np.float32]
) -> NDArray[np.float64]:
    """Return where beams (N,) are at ranges (N,), in the frame of the poses, (N, 3)."""
    if len(poses.translation) == 1:
        aim = beams.directions[ray] @ poses.rotation[0].T
        return np.asarray(poses.translation[0] + aim * range_m[:, None])
    places = np.empty((len(ray), 3))
    places_along(beams.directions, poses.rotation, poses.translation, ray, range_m, places)
    return places
