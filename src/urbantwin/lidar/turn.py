"""One turn of one sensor: its beams placed, and what it reports once they are cast."""

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

#: The number of a turn has so many bits in the key of random numbers.
_TURNS = 1 << 40


class Points(NamedTuple):
    """M points of a turn.

    Attributes:
        xyzi: (M, 4) float32, x, y, z in metres, dataset frame, and intensity 0..1.
        ring: (M,) uint16.
        column: (M,) uint16.
        time_s: (M,) float32, what the sensor's clock says, from the frame's time.
    """

    xyzi: NDArray[np.float32]
    ring: NDArray[np.uint16]
    column: NDArray[np.uint16]
    time_s: NDArray[np.float32]


class Observation(NamedTuple):
    """What one sensor reports in one turn: M returns, sorted by ring and column.

    Attributes:
        sensor: its number in the rig.
        points: where they are.
        actor: (M,) int32, number of the actor that was hit; -1 for the static world.
        semantic: (M,) uint16, class of the static surface; meaningless where an actor was hit.
        echo: (M,) uint8.
        alone: (A,) returns that each actor would give if it were alone in the world.
    """

    sensor: int
    points: Points
    actor: NDArray[np.int32]
    semantic: NDArray[np.uint16]
    echo: NDArray[np.uint8]
    alone: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Turn:
    """The beams of one sensor in one turn, where and when they fire.

    Attributes:
        number: of the sensor among those of the rig that is recorded.
        mounted: the sensor.
        model: what it makes of echoes.
        view: what it would report of the static world.
        sweep: when its beams fire.
        dead: (N,) beams that report nothing; (0,): all work.
        known: what its beams meet of actors that stand; ``None``: it moves, or its beams do.
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
        """The beams as they are cast."""
        return Firing.of(self.view.beams, self.sweep, self.view.poses)

    def looks_at_s(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return when the sensor looks towards places (A, 3), site frame; seconds."""
        rings, sweep = self.view.beams.rings, self.sweep
        if rings is None:
            return np.full(len(places), float(sweep.column_time_s.mean()))
        poses = self.view.poses
        n = len(poses.translation) // 2
        local = (places - poses.translation[n]) @ poses.rotation[n]
        turn = np.arctan2(local[:, 1], local[:, 0]) / rings.step * rings.turn
        return np.asarray(sweep.column_time_s[np.rint(turn).astype(int) % len(sweep.column_time_s)])

    def key(self, seed: int) -> tuple[int, int, int, int]:
        """Return what random numbers are drawn with: seed, sensor, turn and number of beams."""
        return seed, self.mounted.number, self.sweep.turn % _TURNS, len(self.view.beams.directions)

    def draws(self, seed: int, sure: NDArray[np.int64]) -> TurnDraws:
        """Return what chance decides of the beams.

        Args:
            seed: of all random numbers.
            sure: beams none of which the sensor loses by chance.
        """
        key, response, dead = self.key(seed), self.model.response, self.dead
        # What is certain, and exact, needs no draws.
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
    """Return what a sensor reports of one turn.

    Args:
        turn: with its beams placed.
        met: what they meet of the actors, see `casting.cast.cast_actors`.
        actors: everything that moves.
        standing: where the actors stand in their boxes, dataset frame.
        seed: of all random numbers.
    """
    mounted, model, firing, key = turn.mounted, turn.model, turn.firing, turn.key(seed)
    # What the static world answers along all beams is known; a measured one changes by chance.
    view, sure = turn.view, np.zeros(0, np.int64)
    if view.several is not None:
        number, chance = turn.sweep.turn % _TURNS, draw(*key, Purpose.MEASURED).detection
        view, sure = view.drawn(seed, number, number / mounted.turns_per_second, chance)
    draws = turn.draws(seed, sure)
    # Along the beams that touch actors, echoes of both worlds are combined.
    share = view.beams.footprint.share
    echoes, alone = combined(view.layers, actors, met, share, model, mounted.returns)
    view.as_measured(echoes)
    # Echoes that the sensor notices are detections: noisy, quantised, those of actors in their box.
    # Drops, flakes, fog and stray light are detected where they win.
    spurious = Spurious(mounted, model, view, echoes, turn.sweep.ring_time_s, key, draws.dead)
    added, strength = spurious.added()
    dual = mounted.returns == "dual"
    found, touching, slots = detected(view, echoes, draws, model, added.beam, dual=dual)
    within_boxes(found, touching, draws, view, firing, actors, standing, model)
    spurious.settle(added, strength, found, touching, slots)
    if model.offset_m:
        found = found._replace(range_m=np.maximum(found.range_m + model.offset_m, np.float32(0)))
    returns_alone = np.zeros(len(actors.shape), np.int64)
    count_returns(alone, draws, returns_alone)
    return Observation(
        turn.number,
        _points(turn, view, found),
        found.actor,
        found.semantic,
        found.echo,
        returns_alone,
    )


def _points(turn: Turn, view: StaticView, found: Detections) -> Points:
    """Return where detections are believed to be, which they are, and when they were measured."""
    sweep, count = turn.sweep, len(found.beam)
    points = Points(
        np.empty((count, 4), np.float32),
        np.empty(count, np.uint16),
        np.empty(count, np.uint16),
        np.empty(count, np.float32),
    )
    write_points(
        found,
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
