"""From the layers that a beam meets to the echoes that come back."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry.compiled import per_block, per_ray
from urbantwin.lidar.casting.layer_rule import ON_AXIS

__all__ = ["BESIDE", "ActorLayers", "AloneEchoes", "BeamEchoes", "combine"]

#: Added to the actor that owns an echo along a beam whose axis passes beside the actor: the point
#: that is reported lies on the axis, and so beside the actor.
BESIDE = 1 << 20

#: A beam with more layers than this loses the farthest.
_MOST_LAYERS = 128
#: Amplitude below which a surface is neglected, unless nothing passes through it.
_FAINT = 1e-7
#: Black, or met edge on: it is there, however faint.
_FAINTEST = 1e-9


class ActorLayers(NamedTuple):
    """L layers of actors, those of each of N beams chained to each other.

    Attributes:
        last: (N,) int32, the last layer of each beam; -1 for none.
        before: (L,) int32, the one before along the same beam; -1 for none.
        actor: (L,) int32.
        range_m: (L,) float32.
        backscatter: (L,) float64.
        through: (L,) float64, share of the light that passes, to and fro.
        mask: (L,) uint8, which of the beam's rays meet it.
    """

    last: NDArray[np.int32]
    before: NDArray[np.int32]
    actor: NDArray[np.int32]
    range_m: NDArray[np.float32]
    backscatter: NDArray[np.floating]
    through: NDArray[np.floating]
    mask: NDArray[np.uint8]


class BeamEchoes(NamedTuple):
    """Echoes of M beams.

    Attributes:
        start: (M + 1,) int32, where the echoes of each beam begin.
        range_m: (E,) float32.
        amplitude: (E,) float32.
        owner: (E,) int32: an actor, `BESIDE` plus one, or ``-1 - layer`` of the static world.
    """

    start: NDArray[np.int32]
    range_m: NDArray[np.float32]
    amplitude: NDArray[np.float32]
    owner: NDArray[np.int32]


class AloneEchoes(NamedTuple):
    """The strongest echo that each actor alone would give along beams through it.

    Attributes:
        beam: (L,) int32, its number among the M beams.
        actor: (L,) int32.
        range_m: (L,) float32.
        amplitude: (L,) float32.
    """

    beam: NDArray[np.int32]
    actor: NDArray[np.int32]
    range_m: NDArray[np.float32]
    amplitude: NDArray[np.float32]


class _OneBeam(NamedTuple):
    """The layers of one beam, and their order by range."""

    range_m: NDArray[np.float32]
    backscatter: NDArray[np.float32]
    through: NDArray[np.float32]
    mask: NDArray[np.uint8]
    owner: NDArray[np.int32]
    order: NDArray[np.int64]


@per_block
def _one_beam():
    return _OneBeam(
        np.empty(_MOST_LAYERS, np.float32),
        np.empty(_MOST_LAYERS, np.float32),
        np.empty(_MOST_LAYERS, np.float32),
        np.empty(_MOST_LAYERS, np.uint8),
        np.empty(_MOST_LAYERS, np.int32),
        np.empty(_MOST_LAYERS, np.int64),
    )


@per_ray
def _at_least(amplitude):
    """Return the amplitude of an opaque surface: never none."""
    return amplitude if amplitude > _FAINT else _FAINTEST


@per_ray
def _echoes(count, beam, share, left, pulse_m, echoes, at):
    """Write the echoes of one beam's layers from ``at`` on and return how many there are.

    A beam's rays go on behind a layer as far as it lets them through. Layers within a pulse's
    length of the first of them come back as one echo, at their mean range weighed by what each
    returns.
    """
    range_m, back, through, mask, owner, order = beam
    out_range, out_amplitude, out_owner = echoes.range_m, echoes.amplitude, echoes.owner
    for i in range(count):
        order[i] = i
    for i in range(1, count):
        one, j = order[i], i
        while j > 0 and range_m[order[j - 1]] > range_m[one]:
            order[j] = order[j - 1]
            j -= 1
        order[j] = one
    for s in range(len(share)):
        left[s] = share[s]
    used = 0
    first, total, weighed, most = 0.0, 0.0, 0.0, 0.0
    whose = -1
    for i in range(count):
        layer = order[i]
        reach = 0.0
        for s in range(len(share)):
            if mask[layer] >> s & 1:
                reach += left[s]
                left[s] *= through[layer]
        amplitude = reach * back[layer]
        if amplitude <= _FAINT:
            if reach <= 1e-6 or through[layer] > 0.0:
                continue
            amplitude = _FAINTEST
        if total > 0.0 and range_m[layer] - first > pulse_m:
            if at + used < len(out_range):
                out_range[at + used] = weighed / total
                out_amplitude[at + used], out_owner[at + used] = total, whose
            used += 1
            total = 0.0
        if total == 0.0:
            first, weighed, most = range_m[layer], 0.0, 0.0
        total += amplitude
        weighed += amplitude * range_m[layer]
        if amplitude > most:
            most, whose = amplitude, owner[layer]
    if total > 0.0:
        if at + used < len(out_range):
            out_range[at + used] = weighed / total
            out_amplitude[at + used], out_owner[at + used] = total, whose
        used += 1
    return used


@per_block
def combine(touched, static, moving, share, pulse_m, echoes, alone):
    """Combine the static world's layers with the actors' along the beams that touch actors.

    Args:
        touched: (M,) int32 beams.
        static: `static_world.StaticLayers` along all N beams.
        moving: `ActorLayers`.
        share: (S,) float64, of a beam's light that each of its rays carries.
        pulse_m: length of a pulse, there and back.
        echoes: `BeamEchoes` of the M beams, to write.
        alone: `AloneEchoes`, to write.

    Returns:
        How many echoes and how many echoes of actors alone there are; written while there is room.
    """
    own, single, left = _one_beam(), _one_beam(), np.empty(len(share))
    one = BeamEchoes(
        np.empty(0, np.int32),
        np.empty(_MOST_LAYERS, np.float32),
        np.empty(_MOST_LAYERS, np.float32),
        np.empty(_MOST_LAYERS, np.int32),
    )
    used, lone = np.int64(0), np.int64(0)  # literals would compile `_write_alone` once more
    whole = (1 << len(share)) - 1
    light = 0.0
    for s in range(len(share)):
        light += share[s]
    for m in range(len(touched)):
        echoes.start[m] = used
        last, still = moving.last[touched[m]], static.start[touched[m]]
        stands = static.start[touched[m] + 1] - still
        if last < 0 and _is_opaque(static, still, stands, whole):
            if stands:
                if used < len(echoes.range_m):
                    echoes.range_m[used], echoes.owner[used] = static.range_m[still], -1 - still
                    # In single precision, as where several layers are combined.
                    back = np.float64(np.float32(static.backscatter[still]))
                    echoes.amplitude[used] = _at_least(light * back)
                used += 1
            continue
        if _is_plain(static, moving, last, still, stands, whole):
            amplitude = _at_least(light * moving.backscatter[last])
            who, at = moving.actor[last], moving.range_m[last]
            if moving.mask[last] & ON_AXIS:
                _write_alone(alone, lone, m, who, at, amplitude)
                lone += 1
            else:
                who += BESIDE
            if stands and static.range_m[still] <= at:
                at, who = static.range_m[still], -1 - still
                amplitude = _at_least(light * static.backscatter[still])
            if used < len(echoes.range_m):
                echoes.range_m[used], echoes.amplitude[used] = at, amplitude
                echoes.owner[used] = who
            used += 1
            continue
        count = _layers_of(touched[m], static, moving, own)
        used += _echoes(count, own, share, left, pulse_m, echoes, used)
        for i in range(count):
            who = own.owner[i]
            if who < 0 or who >= BESIDE or _is_among(who, own.owner, i):
                continue
            few = _only(who, own, i, count, single)
            several = _echoes(few, single, share, left, pulse_m, one, 0)
            best, strongest = -1, 0.0
            for e in range(min(several, _MOST_LAYERS)):
                strength = one.amplitude[e] / one.range_m[e] ** 2
                if strength > strongest:
                    best, strongest = e, strength
            if best >= 0:
                _write_alone(
                    alone, lone, m, who, one.range_m[best], np.float64(one.amplitude[best])
                )
                lone += 1
    echoes.start[len(touched)] = used
    return used, lone


@per_ray
def _is_plain(static, moving, last, still, stands, whole):
    """Return whether one opaque surface of an actor stands before or behind one of the world's.

    So it is along nearly all beams that touch an actor.
    """
    return (
        last >= 0
        and moving.before[last] < 0
        and moving.through[last] == 0.0
        and moving.mask[last] & whole == whole
        and _is_opaque(static, still, stands, whole)
    )


@per_ray
def _is_opaque(static, still, stands, whole):
    """Return whether a beam meets nothing of the world, or one opaque surface that fills it."""
    if stands == 0:
        return True
    filled = static.mask[still] & whole == whole
    return stands == 1 and static.through[still] == 0.0 and filled


@per_ray
def _layers_of(beam, static, moving, own):
    """Write the layers of a beam, the static world's and the actors', and return how many."""
    count = 0
    for layer in range(static.start[beam], static.start[beam + 1]):
        if count < _MOST_LAYERS:
            own.range_m[count] = static.range_m[layer]
            own.backscatter[count] = static.backscatter[layer]
            own.through[count], own.mask[count] = static.through[layer], static.mask[layer]
            own.owner[count] = -1 - layer
            count += 1
    layer = moving.last[beam]
    while layer >= 0:
        if count < _MOST_LAYERS:
            own.range_m[count] = moving.range_m[layer]
            own.backscatter[count] = moving.backscatter[layer]
            own.through[count], own.mask[count] = moving.through[layer], moving.mask[layer]
            own.owner[count] = moving.actor[layer]
            if not moving.mask[layer] & ON_AXIS:
                own.owner[count] += BESIDE
            count += 1
        layer = moving.before[layer]
    return count


@per_ray
def _is_among(who, owner, count):
    """Return whether one of the first owners is this one."""
    known = False
    for j in range(count):
        known = known or owner[j] == who
    return known


@per_ray
def _only(who, own, first, count, single):
    """Write the layers of one actor, as if it were alone, and return how many there are."""
    few = 0
    for j in range(first, count):
        if own.owner[j] == who:
            single.range_m[few], single.backscatter[few] = own.range_m[j], own.backscatter[j]
            single.through[few], single.mask[few] = own.through[j], own.mask[j]
            single.owner[few] = who
            few += 1
    return few


@per_ray
def _write_alone(alone, at, beam, actor, range_m, amplitude):
    """Write what an actor alone would give, if there is room for it."""
    if at < len(alone.beam):
        alone.beam[at], alone.actor[at] = beam, actor
        alone.range_m[at], alone.amplitude[at] = range_m, amplitude
