"""One turn of one sensor: its placed beams, and its returns after casting."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from urbantwin.lidar.casting.known_layers import KnownLayers
from urbantwin.lidar.casting.tracer import Firing, Layers
from urbantwin.lidar.compiled.alone import count_returns
from urbantwin.lidar.compiled.report import write_points
from urbantwin.lidar.detections import Detections, detected, within_boxes
from urbantwin.lidar.echoes import combined
from urbantwin.lidar.returns import (
    LEVELS,
    Draws,
    Purpose,
    ReturnModel,
    TurnDraws,
    draw,
    standard_quantiles,
)
from urbantwin.lidar.rig import MountedSensor
from urbantwin.lidar.shapes import PresentActors
from urbantwin.lidar.spurious import Spurious
from urbantwin.lidar.standing import Standing
from urbantwin.lidar.static_view import StaticView
from urbantwin.lidar.timing import Sweep

__all__ = ["Observation", "Points", "Turn", "observe"]

#: Turn numbers are taken modulo this in keys of random numbers.
_TURNS = 1 << 40


class Points(NamedTuple):
    """M points of a turn.

    Attributes:
        xyzi: (M, 4) float32, x, y, z in metres, dataset frame, and intensity 0..1.
        ring: (M,) uint16.
        column: (M,) uint16.
        time_s: (M,) float32, sensor's clock, relative to the frame's time.
    """

    xyzi: NDArray[np.float32]
    ring: NDArray[np.uint16]
    column: NDArray[np.uint16]
    time_s: NDArray[np.float32]


class Observation(NamedTuple):
    """The M returns of one sensor in one turn, sorted by ring and column.

    Attributes:
        sensor: index of the sensor in the rig.
        points: the points.
        actor: (M,) int32, index of the actor that was hit; -1 for the static world.
        semantic: (M,) uint16, class of the static surface; undefined where an actor was hit.
        echo: (M,) uint8, number of the return within its beam.
        alone: (A,) returns of each actor without occlusion.
    """

    sensor: int
    points: Points
    actor: NDArray[np.int32]
    semantic: NDArray[np.uint16]
    echo: NDArray[np.uint8]
    alone: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Turn:
    """The beams of one sensor in one turn, placed in space and time.

    Attributes:
        number: index of the sensor in the recorded rig.
        mounted: the sensor.
        model: its return model.
        view: its responses to the static world.
        sweep: firing times.
        dead: (N,) beams in an outage; (0,): none.
        known: cached layers of actors that do not move; ``None`` if the sensor or its beams move.
    """

    number: int
    mounted: MountedSensor
    model: ReturnModel
    view: StaticView
    sweep: Sweep
    dead: NDArray[np.bool_]
    known: KnownLayers | None

    @property
    def firing(self) -> Firing:
        """The beams for ray casting."""
        return Firing.of(self.view.beams, self.sweep, self.view.poses)

    def looks_at_s(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return when (A,), seconds, the sensor points towards places (A, 3), site frame."""
        rings, sweep = self.view.beams.rings, self.sweep
        if rings is None:
            return np.full(len(places), float(sweep.column_time_s.mean()))
        poses = self.view.poses
        n = len(poses.translation) // 2
        local = (places - poses.translation[n]) @ poses.rotation[n]
        turn = np.arctan2(local[:, 1], local[:, 0]) / rings.step * rings.turn
        return np.asarray(sweep.column_time_s[np.rint(turn).astype(int) % len(sweep.column_time_s)])

    def key(self, seed: int) -> tuple[int, int, int, int]:
        """Return the key of the random numbers: seed, sensor, turn and number of beams."""
        return seed, self.mounted.number, self.sweep.turn % _TURNS, len(self.view.beams.directions)

    def draws(self, seed: int, sure: NDArray[np.int64]) -> TurnDraws:
        """Return the random draws of the beams.

        Args:
            seed: random seed.
            sure: beams that are not lost at random.
        """
        key, response, dead = self.key(seed), self.model.response, self.dead
        # Without drop-out and noise no draws are needed.
        certain = not response.dropout and response.sigma_m == 0
        first = _no_draws(key[3]) if certain else draw(*key)
        second = draw(*key, Purpose.SECOND_ECHO) if self.mounted.returns == "dual" else first
        if self.mounted.missing > 0:
            lost = draw(*key, Purpose.MISSING).detection < round(self.mounted.missing * LEVELS)
            lost[sure] = False
            dead = dead | lost if len(dead) else lost
        return TurnDraws(first, second, dead, standard_quantiles())


def observe(
    turn: Turn, met: Layers, actors: PresentActors, standing: Standing, seed: int
) -> Observation:
    """Return the report of a sensor for one turn.

    Args:
        turn: the placed turn.
        met: layers of actors along its beams, see `casting.cast.cast_actors`.
        actors: actors of the frame.
        standing: actors at the times of their boxes, dataset frame.
        seed: random seed.
    """
    mounted, model, firing, key = turn.mounted, turn.model, turn.firing, turn.key(seed)
    # Responses to the static world are precomputed; measured backgrounds vary at random.
    view, sure = turn.view, np.zeros(0, np.int64)
    if view.several is not None:
        number, chance = turn.sweep.turn % _TURNS, draw(*key, Purpose.MEASURED).detection
        view, sure = view.drawn(seed, number, number / mounted.turns_per_second, chance)
    draws = turn.draws(seed, sure)
    # In beams that touch actors, echoes of actors and static world are combined.
    share = view.beams.footprint.share
    echoes, alone = combined(view.layers, actors, met, share, model, mounted.returns)
    view.as_measured(echoes)
    # Detected echoes get noise and quantisation, within the actor's box.
    spurious = Spurious(mounted, model, view, echoes, turn.sweep.ring_time_s, key, draws.dead)
    added, strength = spurious.added()
    dual = mounted.returns == "dual"
    detections, touching, slots = detected(view, echoes, draws, model, added.beam, dual=dual)
    within_boxes(detections, touching, draws, view, firing, actors, standing, model)
    spurious.settle(added, strength, detections, touching, slots)
    if model.offset_m:
        detections = detections._replace(
            range_m=np.maximum(detections.range_m + model.offset_m, np.float32(0))
        )
    returns_alone = np.zeros(len(actors.shape), np.int64)
    count_returns(alone, draws, returns_alone)
    return Observation(
        turn.number,
        _points(turn, view, detections),
        detections.actor,
        detections.semantic,
        detections.echo,
        returns_alone,
    )


def _points(turn: Turn, view: StaticView, detections: Detections) -> Points:
    """Return the reported positions of detections, their channels, columns and times."""
    sweep, count = turn.sweep, len(detections.beam)
    points = Points(
        np.empty((count, 4), np.float32),
        np.empty(count, np.uint16),
        np.empty(count, np.uint16),
        np.empty(count, np.float32),
    )
    write_points(
        detections,
        view.directions,
        view.origin,
        sweep.reported(sweep.column_time_s),
        sweep.ring_time_s * sweep.clock_rate,
        points,
    )
    return points


@lru_cache(maxsize=8)
def _no_draws(count: int) -> Draws:
    nothing = np.zeros(count, np.uint16)
    return Draws(nothing, nothing)
