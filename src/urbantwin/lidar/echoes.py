"""Echoes along the beams of a turn, and which of them a sensor may report."""

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

#: Surfaces within this distance along a beam merge into one echo, metres: half the length of a
#: pulse of 5 ns, the usual duration.
PULSE_M = 0.75


class Answers(NamedTuple):
    """Response of a sensor to one echo of each of N beams.

    Attributes:
        level: (N,) int32, detection probability, of 65,536.
        range_m: (N,) float32; 0 without an echo.
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
    """E echoes along M of N beams, grouped by beam, nearest first.

    Attributes:
        place: (N,) int32, index of each beam among the M; -1 for none.
        beam: (M,) int32.
        start: (M + 1,) int32, index of the first echo of each beam.
        range_m: (E,) float32.
        amplitude: (E,) float32, see ``returns.model``.
        owner: (E,) int32, actor that contributes most (plus `compiled.echoes.BESIDE` if the beam's
            axis misses it), or ``-1 - layer`` of the static world.
        level: (E,) int32, detection probability, of 65,536.
        sigma: (E,) float32, standard deviation of the range, metres.
        intensity: (E,) float32.
        first: (M,) int32, echo that is reported; -1 for none.
        second: (M,) int32, echo that is reported in addition or instead; -1 for none.
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
    """Echo of each actor in each beam without occlusion.

    If a beam at an actor's edge reports the surface behind it, the beam is not counted as the
    actor's.

    Attributes:
        beam: (L,) int32.
        actor: (L,) int32.
        level: (L,) int32, detection probability, of 65,536.
    """

    beam: NDArray[np.int32]
    actor: NDArray[np.int32]
    level: NDArray[np.int32]


def static_echoes(
    static: StaticLayers, share: NDArray[np.float64], model: ReturnModel, returns: ReturnMode
) -> Echoes:
    """Return the echoes of the static world in all N beams.

    Args:
        static: layers of the static world.
        share: (S,) share of a beam's power in each of its rays.
        model: return model of the sensor.
        returns: return mode.
    """
    beams = np.arange(len(static.start) - 1, dtype=np.int32)
    last = np.full(len(beams), -1, np.int32)
    place = beams.copy()
    # The same array types as in `combined`, so that numba compiles `combine` once.
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
    """Return the echoes of actors and static world in the beams that touch actors.

    Args:
        static: layers of the static world in all N beams.
        actors: actors of the frame.
        met: layers of actors.
        share: (S,) share of a beam's power in each of its rays.
        model: return model of the sensor.
        returns: return mode.
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
    count = answer_alone(model.response, lone, echoes, returns == "dual", alone)
    return echoes, Alone._make(values[:count] for values in alone)


def _echoes(
    place: NDArray[np.int32],
    touched: NDArray[np.int32],
    static: StaticLayers,
    moving: ActorLayers,
    share: NDArray[np.float64],
    model: ReturnModel,
    returns: ReturnMode,
) -> tuple[Echoes, AloneEchoes]:
    """Return the echoes of M beams, and those of each actor without occlusion.

    ``place`` (N,) is the index of each beam among the M, -1 for none.
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
