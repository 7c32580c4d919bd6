"""Echoes: what comes back along the beams of a turn, and which of it a sensor may report."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from urbantwin.lidar.casting.tracer import Layers
from urbantwin.lidar.compiled.alone import answer_alone
from urbantwin.lidar.compiled.echoes import (
    ActorLayers,
    AloneEchoes,
    BeamEchoes,
    combine,
)
from urbantwin.lidar.compiled.order import chained
from urbantwin.lidar.compiled.return_mode import MODES, choose
from urbantwin.lidar.returns import ReturnModel
from urbantwin.lidar.rig import ReturnMode
from urbantwin.lidar.shapes import PresentActors
from urbantwin.lidar.static_world import StaticLayers

__all__ = ["PULSE_M", "Alone", "Answers", "Echoes", "combined", "static_echoes"]

#: Surfaces nearer to each other than this along a beam come back as one echo, metres: half the
#: way that light goes in a pulse of 5 ns, the usual length.
PULSE_M = 0.75


class Answers(NamedTuple):
    """What a sensor answers to one echo of each of N beams.

    Attributes:
        level: (N,) int32, the level below which a draw means a return.
        range_m: (N,) float32; 0 where there is no echo.
        sigma: (N,) float32, standard deviation of the range, metres.
        intensity: (N,) float32.
        semantic: (N,) uint16, class of the surface.
    """

    level: NDArray[np.int32]
    range_m: NDArray[np.float32]
    sigma: NDArray[np.float32]
    intensity: NDArray[np.float32]
    semantic: NDArray[np.uint16]


class Echoes(NamedTuple):
    """E echoes along M of N beams, those of a beam next to each other, nearest first.

    Attributes:
        place: (N,) int32, the number of each beam among the M; -1 for one that is not.
        beam: (M,) int32.
        start: (M + 1,) int32, where the echoes of each beam begin.
        range_m: (E,) float32.
        amplitude: (E,) float32, see ``returns.model``.
        owner: (E,) int32, the actor that most of it is from (plus `compiled.echoes.BESIDE` where
            the beam's axis passes beside it), or ``-1 - layer`` of the static world.
        level: (E,) int32, the level below which a draw means a return.
        sigma: (E,) float32, standard deviation of the range, metres.
        intensity: (E,) float32.
        first: (M,) int32, the echo that is reported; -1 for none.
        second: (M,) int32, the one that is reported too, or in its place; -1 for none.
    """

    place: NDArray[np.int32]
    beam: NDArray[np.int32]
    start: NDArray[np.int32]
    range_m: NDArray[np.float32]
    amplitude: NDArray[np.float32]
    owner: NDArray[np.int32]
    level: NDArray[np.int32]
    sigma: NDArray[np.float32]
    intensity: NDArray[np.float32]
    first: NDArray[np.int32]
    second: NDArray[np.int32]


class Alone(NamedTuple):
    """The echo that each actor would give along a beam if nothing stood before it.

    Of a beam that meets an actor's edge, what is behind may give the echo that is reported: such a
    beam is not the actor's, though nothing hides it.

    Attributes:
        beam: (L,) int32.
        actor: (L,) int32.
        level: (L,) int32, the level below which a draw means a return.
    """

    beam: NDArray[np.int32]
    actor: NDArray[np.int32]
    level: NDArray[np.int32]


def static_echoes(
    static: StaticLayers, share: NDArray[np.float64], model: ReturnModel, returns: ReturnMode
) -> Echoes:
    """Return the echoes of the static world along all N beams.

    Args:
        static: what the beams meet.
        share: (S,) of a beam's light that each of its rays carries.
        model: what the sensor makes of echoes.
        returns: which of them it reports.
    """
    beams = np.arange(len(static.start) - 1, dtype=np.int32)
    last = np.full(len(beams), -1, np.int32)
    place = beams.copy()
    # Of the types that materials give in `combined`: what combines them is compiled once.
    whole, range_m, mask = np.zeros(0, np.int32), np.zeros(0, np.float32), np.zeros(0, np.uint8)
    nothing = ActorLayers(last, whole, whole, range_m, np.zeros(0), np.zeros(0), mask)
    return _echoes(place, beams, static, nothing, share, model, returns)[0]


def combined(
    static: StaticLayers,
    actors: PresentActors,
    met: Layers,
    share: NDArray[np.float64],
    model: ReturnModel,
    returns: ReturnMode,
) -> tuple[Echoes, Alone]:
    """Return the echoes of the beams that touch actors: of these and of the static world.

    Args:
        static: what all N beams meet of the static world.
        actors: everything that moves.
        met: what beams meet of it.
        share: (S,) of a beam's light that each of its rays carries.
        model: what the sensor makes of echoes.
        returns: which of them it reports.
    """
    place = np.full(len(static.start) - 1, -1, np.int32)
    before = np.empty(len(met.ray), np.int32)
    touched, last = chained(met.ray, place, before)
    material = actors.material(met.actor, met.face)
    back, through = model.scatter.of_actors(met.ray, met.face, material, met.cosine)
    moving = ActorLayers(last, before, met.actor, met.range_m, back, through, met.mask)
    echoes, lone = _echoes(place, touched, static, moving, share, model, returns)
    room = len(lone.beam)
    alone = Alone(np.empty(room, np.int32), np.empty(room, np.int32), np.empty(room, np.int32))
    kept = answer_alone(model.response, lone, echoes, returns == "dual", alone)
    return echoes, Alone._make(values[:kept] for values in alone)


def _echoes(
    place: NDArray[np.int32],
    touched: NDArray[np.int32],
    static: StaticLayers,
    moving: ActorLayers,
    share: NDArray[np.float64],
    model: ReturnModel,
    returns: ReturnMode,
) -> tuple[Echoes, AloneEchoes]:
    """Return the echoes of some beams (M,), and what actors alone would give.

    ``place`` is the number (N,) of every beam among them, -1 for none.
    """
    layers = len(moving.before)
    most = 2 * len(touched) + layers + 16
    while True:
        echoes = BeamEchoes(
            np.empty(len(touched) + 1, np.int32),
            np.empty(most, np.float32),
            np.empty(most, np.float32),
            np.empty(most, np.int32),
            np.empty(most, np.float32),
        )
        alone = AloneEchoes(
            np.empty(layers, np.int32),
            np.empty(layers, np.int32),
            np.empty(layers, np.float32),
            np.empty(layers, np.float32),
        )
        used, lone = combine(touched, static, moving, share, np.float32(PULSE_M), echoes, alone)
        if used <= most:
            break
        most = used
    range_m, amplitude = echoes.range_m[:used], echoes.amplitude[:used]
    level, sigma, intensity, strength = model.answers(amplitude, range_m, peak=echoes.peak[:used])
    first, second = choose(echoes.start, strength, level, MODES.index(returns))
    return Echoes(
        place,
        touched,
        echoes.start,
        range_m,
        amplitude,
        echoes.owner[:used],
        level,
        sigma,
        intensity,
        first,
        second,
    ), AloneEchoes._make(values[:lone] for values in alone)
