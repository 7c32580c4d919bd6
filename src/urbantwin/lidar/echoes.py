"""Echoes: what comes back along the beams of a turn, and which of it a sensor may report."""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from urbantwin.lidar.compiled.echoes import BESIDE, MOST_LAYERS, combine
from urbantwin.lidar.compiled.order import chained
from urbantwin.lidar.compiled.slots import choose
from urbantwin.lidar.layers import Layers, PresentActors
from urbantwin.lidar.returns import ReturnModel
from urbantwin.lidar.static import StaticLayers

__all__ = ["PULSE_M", "Alone", "Echoes", "combined"]

#: Surfaces nearer to each other than this along a beam come back as one echo, metres: half the
#: way that light goes in a pulse of 5 ns, the usual length.
PULSE_M = 0.75
#: As ``compiled.slots`` counts them.
_MODES = ("strongest", "last", "dual", "first")


class Echoes(NamedTuple):
    """E echoes along M beams, those of a beam next to each other, nearest first.

    Attributes:
        beam: (M,) int32.
        start: (M + 1,) int32, where the echoes of each beam begin.
        range_m: (E,) float32.
        amplitude: (E,) float32, see ``returns.model``.
        owner: (E,) int32, the actor that most of it is from (plus `compiled.echoes.BESIDE` where
            the beam's axis passes beside it), or ``-1 - layer`` of the static world.
        level: (E,) int32, the level below which a draw means a return.
        sigma: (E,) float32, standard deviation of the range, metres.
        intensity: (E,) float32.
        peak: (E,) float32, what is left of the pulse's peak, see ``returns.stretch``.
        first: (M,) int32, the echo that is reported; -1 for none.
        second: (M,) int32, the one that is reported too, or in its place; -1 for none.
    """

    beam: NDArray[np.int32]
    start: NDArray[np.int32]
    range_m: NDArray[np.float32]
    amplitude: NDArray[np.float32]
    owner: NDArray[np.int32]
    level: NDArray[np.int32]
    sigma: NDArray[np.float32]
    intensity: NDArray[np.float32]
    peak: NDArray[np.float32]
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


def combined(
    static: StaticLayers,
    moving: tuple[PresentActors, Layers] | None,
    share: NDArray[np.float64],
    model: ReturnModel,
    returns: Literal["strongest", "last", "dual", "first"],
) -> tuple[Echoes, Alone]:
    """Return the echoes of the beams that touch actors, or without actors of all beams.

    Args:
        static: the static world along all N beams.
        moving: the actors and their layers; ``None``: the echoes of the static world along all
            beams.
        share: (S,) of a beam's light that each of its rays carries.
        model: what the sensor makes of echoes.
        returns: which of them it reports.
    """
    beams = len(static.start) - 1
    head = np.full(beams, -1, np.int32)
    if moving is None:
        touched = np.arange(beams, dtype=np.int32)
        whole, real = np.zeros(0, np.int32), np.zeros(0, np.float32)
        chain = (head, whole, whole, real, real, real, np.zeros(0, np.uint8))
        layers = 0
    else:
        actors, met = moving
        layers = len(met.ray)
        before = np.empty(layers, np.int32)
        touched = chained(met.ray, head, before)
        material = actors.shapes.material.take(actors.first_face.take(met.actor) + met.face)
        back = model.scatter.backscatter(material, met.cosine)
        through = model.scatter.transmission(material, met.cosine)
        chain = (head, before, met.actor, met.range_m, back, through, met.mask)
    still = (static.start, static.range_m, static.backscatter, static.through, static.mask)
    room = (_scratch(), _scratch(), np.empty(len(share)))
    most = 2 * len(touched) + layers + 16
    while True:
        start = np.empty(len(touched) + 1, np.int32)
        echoes: tuple[NDArray[Any], ...] = (
            np.empty(most, np.float32),
            np.empty(most, np.float32),
            np.empty(most, np.int32),
        )
        alone: tuple[NDArray[Any], ...] = (
            np.empty(layers, np.int32),
            np.empty(layers, np.int32),
            np.empty(layers, np.float32),
            np.empty(layers, np.float32),
        )
        used, lone = combine(
            touched, still, chain, share, np.float32(PULSE_M), room, (start, *echoes), alone
        )
        if used <= most:
            break
        most = used
    range_m, amplitude, owner = (values[:used] for values in echoes)
    peak = np.ones(used, np.float32)
    if static.cosine is not None and model.divergence_rad > 0:
        row = np.flatnonzero(owner < 0)
        layer = -1 - owner[row]
        peak[row] = model.peak_left(static.range_m[layer], static.cosine[layer])
    level, sigma, intensity = model.answers(amplitude, range_m, peak=peak)
    strength = model.strength(amplitude, range_m) * peak
    first, second = choose(start, strength, level, _MODES.index(returns))
    beam, actor, lone_range, lone_amplitude = (values[:lone] for values in alone)
    lone_level = model.answers(lone_amplitude, lone_range)[0]
    found = Echoes(
        touched, start, range_m, amplitude, owner, level, sigma, intensity, peak, first, second
    )
    # A thin ray meets what is in front or what is behind, and both only through a pane.
    if len(share) == 1 and not model.scatter.through.any():
        return found, Alone(touched.take(beam), actor, lone_level)
    own = ~_is_from_behind(found, beam, actor, lone_range)
    return found, Alone(touched.take(beam[own]), actor[own], lone_level[own])


def _is_from_behind(
    echoes: Echoes,
    beam: NDArray[np.int32],
    actor: NDArray[np.int32],
    range_m: NDArray[np.float32],
) -> NDArray[np.bool_]:
    """Return whether beams (L,) report what is behind actors (L,) that they meet at ranges (L,)."""
    first, second = echoes.first[beam], echoes.second[beam]
    mine = np.zeros(len(beam), np.bool_)
    for one in (first, second):
        mine |= (one >= 0) & (echoes.owner[one] % BESIDE == actor) & (echoes.owner[one] >= 0)
    behind = (first >= 0) & (echoes.range_m[first] > range_m)
    return np.asarray(behind & ~mine)


def _scratch() -> tuple[NDArray[Any], ...]:
    kinds = (np.float32, np.float32, np.float32, np.uint8, np.int32, np.int64)
    return tuple(np.empty(MOST_LAYERS, kind) for kind in kinds)
