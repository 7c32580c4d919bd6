"""One sensor of the rig: everything about its rays that no frame changes, and what it reports."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import LabelledMesh, Pose, SurfaceMaterials
from urbantwin.lidar.actors import ActorShape, cast_actors, nearest
from urbantwin.lidar.casting import EmbreeCaster
from urbantwin.lidar.gather import StaticReturns, gather
from urbantwin.lidar.labels import BOX_MARGIN_M, outside, spans_in_box
from urbantwin.lidar.pattern import beam_directions, pattern_directions
from urbantwin.lidar.rectangle import RayGrid, RayList, Rays
from urbantwin.lidar.returns import (
    Draws,
    ReturnModel,
    standard_noise,
    standard_quantiles,
    truncated_noise,
)
from urbantwin.lidar.rig import MountedSensor
from urbantwin.lidar.static import cast_static

__all__ = ["Observation", "Observer"]


@dataclass(frozen=True, eq=False)
class Observation:
    """What one sensor reports in one frame: M returns, sorted by ring and column.

    Attributes:
        points: (M, 4) float32, x, y, z in metres, dataset frame, and intensity 0..1.
        actor: (M,) int32, number of the actor that was hit; -1 for the static world.
        semantic: (M,) uint16, class of the static surface; meaningless where an actor was hit.
        ring: (M,) uint16.
        column: (M,) uint16.
        alone: (A,) returns that each actor would give if it were alone in the world.
    """

    points: NDArray[np.float32]
    actor: NDArray[np.int32]
    semantic: NDArray[np.uint16]
    ring: NDArray[np.uint16]
    column: NDArray[np.uint16]
    alone: NDArray[np.int64]


class Observer:
    """A mounted sensor with its static hits.

    Args:
        mounted: the sensor.
        static: the static world, site frame.
        dataset_SE3_site: to the frame that points are given in.
        surface: materials of the ground that are finer than the static world's triangles.
        frame: the frame that it observes; it matters to a sensor whose pattern does not repeat.
        caster: of the static world moved to the sensor, where it is known already.
    """

    def __init__(
        self,
        mounted: MountedSensor,
        static: LabelledMesh,
        dataset_SE3_site: Pose,
        surface: SurfaceMaterials | None = None,
        *,
        frame: int = 0,
        caster: EmbreeCaster | None = None,
    ) -> None:
        self._pose = mounted.site_SE3_sensor
        self._range_max_m = mounted.sensor.assumed_range_max_m
        self._model = ReturnModel(mounted)
        # Half a step of the range may come on top of the noise.
        self._margin_m = max(0.0, BOX_MARGIN_M - mounted.sensor.assumed_range_resolution_m / 2)

        pattern, columns = mounted.sensor.pattern, mounted.columns
        if pattern is None:
            beams = beam_directions(mounted.sensor, columns).reshape(-1, 3)
            self._grid: Rays = RayGrid(mounted.sensor, columns)
        else:
            beams = pattern_directions(pattern, columns, frame, mounted.rate_hz).reshape(-1, 3)
            self._grid = RayList(beams)
        in_site = beams @ self._pose.rotation.T
        self._directions_site = in_site.astype(np.float32)
        # Component by component: numpy multiplies long rows many times as fast as short ones.
        self._directions = (dataset_SE3_site.rotation @ in_site.T).astype(np.float32)
        self._origin = dataset_SE3_site.apply(self._pose.translation[None])[0]
        self._wavelength_nm = mounted.sensor.assumed_wavelength_nm
        hits = cast_static(
            static,
            self._pose.translation,
            in_site,
            wavelength_nm=self._wavelength_nm,
            surface=surface,
            caster=caster,
        )
        self._range_m = hits.range_m
        # What no ray hit has no level, so its range never counts: any finite number will do.
        finite = np.where(np.isfinite(hits.range_m), hits.range_m, np.float32(1e6))
        self._level = self._model.detection_level(hits.backscatter, finite)
        self._static = StaticReturns(
            self._directions,
            self._origin.astype(np.float32),
            finite.astype(np.float32),
            self._model.sigma(hits.backscatter, finite),
            self._model.intensity(hits.backscatter),
            hits.semantic,
            self._model.step_m,
            mounted.columns,
        )

    @property
    def rays(self) -> int:
        """How many rays the sensor fires in a frame."""
        return len(self._level)

    def observe(
        self,
        actors: Sequence[tuple[ActorShape, Pose]],
        boxes: NDArray[np.float64],
        draws: Draws,
    ) -> Observation:
        """Return what the sensor reports.

        Args:
            actors: shape and pose (``site_SE3_asset``) of each.
            boxes: (A, 7) their boxes, dataset frame.
            draws: the random numbers of this sensor and frame.
        """
        hits = cast_actors(
            self._grid,
            self._directions_site,
            self._pose,
            self._range_max_m,
            actors,
            self._wavelength_nm,
        )
        hit_level = self._model.detection_level(hits.backscatter, hits.range_m)
        would_return = draws.detection[hits.ray] < hit_level
        alone = np.bincount(hits.actor[would_return], minlength=len(actors))

        chosen = nearest(hits, self._range_m)
        ray = hits.ray[chosen]
        level = self._level.copy()
        level[ray] = hit_level[chosen]
        front = np.full(self.rays, -1, np.int32)
        front[ray] = chosen
        back = gather(self._static, level, front, draws, standard_quantiles())

        moving = np.flatnonzero(back.front >= 0)
        hit, ray_hit = back.front[moving], back.ray[moving]
        actor = np.full(len(back.front), -1, np.int32)
        actor[moving] = hits.actor[hit]
        directions = self._directions.take(ray_hit, axis=1)
        scatter, at = hits.backscatter[hit], hits.range_m[hit]
        measured = self._measured(
            directions,
            at,
            self._model.sigma(scatter, at),
            draws.noise[ray_hit],
            boxes.T.take(hits.actor[hit], axis=1),
        )
        points = back.points
        points[moving, :3] = (directions * measured + self._static.origin[:, None]).T
        points[moving, 3] = self._model.intensity(scatter)
        return Observation(points, actor, back.semantic, back.ring, back.column, alone)

    def _measured(
        self,
        directions: NDArray[np.float32],
        range_m: NDArray[np.float32],
        sigma: NDArray[np.float32],
        noise: NDArray[np.uint16],
        box: NDArray[np.float64],
    ) -> NDArray[np.float32]:
        """Return the ranges (M,) reported of actors: noisy, in their boxes (7, M), quantised."""
        measured = range_m + sigma * standard_noise(noise)
        places = self._origin[:, None] + directions.astype(np.float64) * measured
        leaves = np.flatnonzero(outside(places, box, self._margin_m) & (sigma > 0))
        if len(leaves):
            aim = directions.take(leaves, axis=1).astype(np.float64)
            span = spans_in_box(self._origin, aim, box.take(leaves, axis=1), self._margin_m)
            low, high = ((end - range_m[leaves]) / sigma[leaves] for end in span)
            kept = truncated_noise(noise[leaves], np.minimum(low, 0), np.maximum(high, 0))
            measured[leaves] = range_m[leaves] + sigma[leaves] * kept
        return self._model.quantised(measured)
