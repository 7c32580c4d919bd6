"""The static world along a sensor's beams; computed once for a fixed sensor."""

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
    """Layers of the static world along N beams, grouped by beam.

    Attributes:
        start: (N + 1,) int64, index of the first layer of each beam.
        range_m: (L,) float32.
        backscatter: (L,) float64, see ``returns.scatter``.
        through: (L,) float64, two-way transmission.
        mask: (L,) uint8, rays of the beam that hit it.
        semantic: (L,) uint16.
        peak: (L,) float32, remaining peak of the stretched pulse, see ``returns.model``.
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
        """Beam (L,) of each layer."""
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
        """Keep some of the layers, and add one opaque surface that fills each of M beams.

        Args:
            kept: (L,) layers to keep.
            beam: (M,) beams of the added surfaces, at normal incidence.
            range_m: (M,) their ranges.
            backscatter: (M,) their backscatter.
            semantic: (M,) their class.
            rays: number of rays per beam.
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
    """The static world for ray casting.

    The mesh is moved to ``origin`` in float64 before it becomes float32, so that errors near a
    sensor do not grow with its distance from the anchor; ranges are evaluated on the triangles'
    planes in float64.

    Args:
        mesh: the static world, site frame.
        origin: (3,) origin of the float32 frame, near the sensors.
        surface: materials of the ground at finer resolution than the mesh.
        tracer: ray tracer.
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
        # Rooms are not modelled: light that enters a window is lost, and does not return from the
        # far side of a hollow building.
        shape.planes["pane"] &= mesh.semantic != semantic_id("building")
        self._shapes = Shapes.of([shape])
        self._ground = mesh.is_ground

    def layers(
        self, beams: Beams, sweep: Sweep, poses: SensorPoses, model: ReturnModel, *, thorough: bool
    ) -> StaticLayers:
        """Return the layers along beams.

        Args:
            beams: beams of the sensor.
            sweep: firing times.
            poses: poses of the sensor, site frame.
            model: return model of the sensor.
            thorough: see `casting.cast.cast_world`.
        """
        scatter = model.scatter
        here = SensorPoses(poses.rotation, poses.translation - self._origin)
        hits = cast_world(
            self._tracer,
            beams,
            Firing.of(beams, sweep, here),
            self._shapes,
            glass=bool((scatter.through > 0).any()),
            thorough=thorough,
        )
        start, order = by_ray(hits.ray, len(beams.directions))
        ray, face = hits.ray.take(order), hits.face.take(order)
        range_m, cosine = hits.range_m.take(order), hits.cosine.take(order)
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
            hits.mask.take(order),
            self._mesh.semantic.take(face),
            model.peak_left(range_m, cosine),
        )


def _places(
    beams: Beams, poses: SensorPoses, ray: NDArray[np.int32], range_m: NDArray[np.float32]
) -> NDArray[np.float64]:
    """Return the points (N, 3) at ranges (N,) along beams (N,), in the frame of the poses."""
    if len(poses.translation) == 1:
        aim = beams.directions[ray] @ poses.rotation[0].T
        return np.asarray(poses.translation[0] + aim * range_m[:, None])
    places = np.empty((len(ray), 3))
    places_along(beams.directions, poses.rotation, poses.translation, ray, range_m, places)
    return places
