"""One sensor of the rig in one turn: what its beams meet, and what it reports."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.lidar.compiled.carried import leaving
from urbantwin.lidar.compiled.echoes import BESIDE
from urbantwin.lidar.compiled.gather import OUTLIER, gather, write_points
from urbantwin.lidar.echoes import Echoes, combined
from urbantwin.lidar.labels.kept_in_box import BOX_MARGIN_M, spans_in_box
from urbantwin.lidar.layers import Layers, PresentActors, cast_actors
from urbantwin.lidar.mounted import MountedSensor
from urbantwin.lidar.returns import (
    LEVELS,
    Draws,
    Purpose,
    ReturnModel,
    draw,
    standard_noise,
    standard_quantiles,
    truncated_noise,
)
from urbantwin.lidar.spurious import Reported, Spurious
from urbantwin.lidar.static_view import StaticView
from urbantwin.lidar.sweep import Sweep

__all__ = ["Observation", "Sighting"]

#: Turns are told apart in the key of random numbers by so many bits.
_TURNS = 1 << 40


@dataclass(frozen=True, eq=False)
class Observation:
    """What one sensor reports in one turn: M returns, sorted by ring and column.

    Attributes:
        points: (M, 4) float32, x, y, z in metres, dataset frame, and intensity 0..1.
        actor: (M,) int32, number of the actor that was hit; -1 for the static world.
        semantic: (M,) uint16, class of the static surface; meaningless where an actor was hit.
        ring: (M,) uint16.
        column: (M,) uint16.
        time_s: (M,) float32, what the sensor's clock says, from the frame's time.
        echo: (M,) uint8.
        alone: (A,) returns that each actor would give if it were alone in the world.
    """

    points: NDArray[np.float32]
    actor: NDArray[np.int32]
    semantic: NDArray[np.uint16]
    ring: NDArray[np.uint16]
    column: NDArray[np.uint16]
    time_s: NDArray[np.float32]
    echo: NDArray[np.uint8]
    alone: NDArray[np.int64]


class Sighting:
    """One turn of a sensor: what its beams meet.

    Args:
        mounted: the sensor.
        model: what it makes of echoes.
        view: what it would report of the static world.
        sweep: when its beams fire.
        actors: everything that moves.
        dead: (N,) beams that report nothing; ``None``: all work.

    Attributes:
        seen_s: (A,) mean time at which beams met each actor, seconds; ``nan`` where none did.
        seen: (A,) how many did.
    """

    def __init__(
        self,
        mounted: MountedSensor,
        model: ReturnModel,
        view: StaticView,
        sweep: Sweep,
        actors: PresentActors,
        dead: NDArray[np.bool_] | None,
    ) -> None:
        self._mounted, self._model, self._view, self._sweep = mounted, model, view, sweep
        self._actors = actors
        self._dead = np.zeros(0, np.bool_) if dead is None else dead.reshape(-1)
        self._layers: Layers = cast_actors(
            view.beams,
            sweep,
            view.poses,
            actors,
            mounted.sensor.assumed_range_max_m,
            glass=mounted.effects.glass,
        )
        self.seen_s, self.seen = self._layers.seen_s, self._layers.seen

    def looks_at_s(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return when the sensor looks towards places (A, 3), site frame; seconds."""
        rings, sweep = self._view.beams.rings, self._sweep
        if rings is None:
            return np.full(len(places), float(sweep.column_time_s.mean()))
        poses = self._view.poses
        n = len(poses.translation) // 2
        local = (places - poses.translation[n]) @ poses.rotation[n]
        turn = np.arctan2(local[:, 1], local[:, 0]) / rings.step * rings.turn
        return np.asarray(sweep.column_time_s[np.rint(turn).astype(int) % len(sweep.column_time_s)])

    def report(
        self,
        boxes: NDArray[np.float64],
        dataset_SE3_actors: tuple[NDArray[np.float64], NDArray[np.float64]],
        seed: int,
    ) -> Observation:
        """Return what the sensor reports.

        Args:
            boxes: (A, 7) boxes of the actors, dataset frame.
            dataset_SE3_actors: rotations (A, 3, 3) and translations (A, 3) of the actors where
                they stand in their boxes.
            seed: of all random numbers.
        """
        view, beams, mounted = self._view, self._view.beams, self._mounted
        dead, shape_count = self._dead, len(self._actors.shape)
        count = len(beams.directions)
        key = (seed, mounted.number, self._sweep.turn % _TURNS, count)
        response = self._model.response
        # What is certain, and exact, needs no draws.
        draws = draw(*key) if response.dropout or response.sigma_m > 0 else _no_draws(count)
        if mounted.missing > 0:
            lost = draw(*key, Purpose.MISSING).detection < round(mounted.missing * LEVELS)
            dead = dead | lost if len(dead) else lost
        if view.several is not None:
            view = view.drawn(draw(*key, Purpose.MEASURED).detection)
        both = mounted.returns == "dual"
        others = draw(*key, Purpose.SECOND_ECHO) if both else draws

        echoes: Echoes | None = None
        alone = np.zeros(shape_count, np.int64)
        front = np.full(count, -1, np.int32)
        if len(self._layers.ray):
            echoes, lone = combined(
                view.layers,
                (self._actors, self._layers),
                beams.footprint.share,
                self._model,
                mounted.returns,
            )
            view.as_measured(echoes)
            front[echoes.beam] = np.arange(len(echoes.beam), dtype=np.int32)
            returns = draws.detection[lone.beam] < lone.level
            if len(dead):
                returns &= ~dead[lone.beam]
            alone = np.bincount(lone.actor[returns], minlength=shape_count)
        moving = _moving(front, echoes, view.layers.semantic)
        out = _room(count * 2 if mounted.returns == "dual" else count)
        found = gather(
            view.report,
            (view.other, *view.second),
            moving,
            dead,
            (draws.detection, draws.noise),
            (others.detection, others.noise),
            standard_quantiles(),
            self._model.step_m,
            both,
            out,
        )
        beam, echo, source, semantic, range_m, intensity = (values[:found] for values in out)
        actor = np.full(found, -1, np.int32)
        if echoes is not None:
            dynamic = np.flatnonzero(source >= 0)
            owner = echoes.owner[source[dynamic]]
            owned = (owner >= 0) & (owner < BESIDE)
            hit = dynamic[owned]
            actor[hit] = owner[owned]
            noise = np.where(echo[hit] == 0, draws.noise[beam[hit]], others.noise[beam[hit]])
            range_m[hit], misses = self._in_boxes(
                beam[hit],
                actor[hit],
                echoes.range_m[source[hit]],
                echoes.sigma[source[hit]],
                noise,
                boxes,
                dataset_SE3_actors,
            )
            actor[hit[misses]], semantic[hit[misses]] = -1, OUTLIER
        spurious = Spurious(mounted, self._model, view, echoes, self._sweep.ring_time_s, key, dead)
        beam, echo, _, semantic, range_m, intensity, actor = spurious.among(
            Reported(beam, echo, source, semantic, range_m, intensity, actor)
        )
        if self._model.offset_m:
            range_m = np.maximum(range_m + self._model.offset_m, np.float32(0))
        count = len(beam)
        points, time_s = np.empty((count, 4), np.float32), np.empty(count, np.float32)
        ring, column = np.empty(count, np.uint16), np.empty(count, np.uint16)
        sweep = self._sweep
        write_points(
            beam,
            range_m,
            intensity,
            view.directions,
            view.origin,
            sweep.reported(sweep.column_time_s),
            sweep.ring_time_s * sweep.clock_rate,
            (points, ring, column, time_s),
        )
        return Observation(points, actor, semantic, ring, column, time_s, echo, alone)

    def _in_boxes(
        self,
        beam: NDArray[np.int32],
        actor: NDArray[np.int32],
        range_m: NDArray[np.float32],
        sigma: NDArray[np.float32],
        noise: NDArray[np.uint16],
        boxes: NDArray[np.float64],
        dataset_SE3_actors: tuple[NDArray[np.float64], NDArray[np.float64]],
    ) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
        """Return the ranges (M,) reported of actors: noisy, in their boxes, quantised.

        A beam is carried along with its actor to where that stands in its box. Beams that pass
        beside the box all the same (it stands upright, the actor may not) are returned too.
        """
        step_m = float(self._model.step_m)
        thin = len(self._view.beams.footprint.share) == 1
        if thin and not step_m and not self._view.beams.aside and self._model.response.sigma_m == 0:
            return range_m, np.zeros(0, np.int64)  # On the mesh, which the box holds.
        measured = range_m + sigma * standard_noise(noise)
        # Half a step of the range may come on top, and half a step of the azimuth.
        aside = self._view.beams.aside * float(range_m.max(initial=0.0))
        margin = max(0.0, BOX_MARGIN_M - step_m / 2 - aside)
        sweep = self._sweep
        leaves, origin, aim = leaving(
            beam,
            actor,
            measured,
            tuple(self._actors.paths),
            *self._view.poses,
            (sweep.column_time_s, sweep.ring_time_s),
            self._view.beams.directions,
            *dataset_SE3_actors,
            boxes,
            margin,
        )
        if len(leaves):
            own = boxes.T.take(actor[leaves], axis=1)
            low, high = spans_in_box(origin, aim, own, margin)
            # What several surfaces give together may lie between them: it is brought inside first.
            at = np.clip(range_m[leaves], np.minimum(low, high), high)
            wide = np.maximum(sigma[leaves].astype(np.float64), 1e-9)
            kept = truncated_noise(
                noise[leaves],
                np.minimum((low - at) / wide, 0),
                np.maximum((high - at) / wide, 0),
            )
            measured[leaves] = np.where(sigma[leaves] > 0, at + wide * kept, at)
            leaves = leaves[low > high]
        return self._model.quantised(measured), leaves


def _moving(
    front: NDArray[np.int32], echoes: Echoes | None, semantic: NDArray[np.uint16]
) -> tuple[NDArray[Any], ...]:
    """Return the echoes of beams that touch actors as ``compiled.gather`` takes them."""
    if echoes is None:
        whole, real = np.zeros(0, np.int32), np.zeros(0, np.float32)
        return front, whole, whole, whole, real, real, real, whole, semantic
    return (
        front,
        echoes.first,
        echoes.second,
        echoes.level,
        echoes.range_m,
        echoes.sigma,
        echoes.intensity,
        echoes.owner,
        semantic,
    )


def _room(count: int) -> tuple[NDArray[Any], ...]:
    return (
        np.empty(count, np.int32),
        np.empty(count, np.uint8),
        np.empty(count, np.int32),
        np.empty(count, np.uint16),
        np.empty(count, np.float32),
        np.empty(count, np.float32),
    )


@lru_cache(maxsize=8)
def _no_draws(count: int) -> Draws:
    nothing = np.zeros(count, np.uint16)
    return Draws(nothing, nothing)
