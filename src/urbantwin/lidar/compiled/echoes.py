"""From the layers that a beam meets to the echoes that come back."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry.compiled import per_block, per_ray
from urbantwin.geometry.compiled.prefetch import prefetch
from urbantwin.lidar.casting.layer_rule import ON_AXIS

__all__ = ["BESIDE", "ActorLayers", "AloneEchoes", "BeamEchoes", "combine"]

#: Added to the actor that owns an echo along a beam whose axis passes beside the actor: the point
#: that is reported lies on the axis, and so beside the actor.
BESIDE = 1 << 20

#: Number of beams by which the world's layers are prefetched.
_AHEAD = 8

#: A beam with more layers than this loses the farthest.
_MOST_LAYERS = 128
#: Amplitude below which a surface is neglected, unless nothing passes through it.
_FAINT = 1e-7
#: Amplitude of a black surface, or of one seen edge-on.
_FAINTEST = 1e-9


class ActorLayers(NamedTuple):
    """L layers of actors, those of each of M beams chained to each other.

    Attributes:
        last: (M,) int32, the last layer of each beam; -1 for none.
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
        peak: (E,) float32, what is left of its pulse's peak.
    """

    start: NDArray[np.int32]
    range_m: NDArray[np.float32]
    amplitude: NDArray[np.float32]
    owner: NDArray[np.int32]
    peak: NDArray[np.float32]


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


#: A layer of one beam, and an echo of it.
_LAYER = np.dtype(
    [(name, "f4") for name in ("range_m", "backscatter", "through")]
    + [("mask", "i4"), ("owner", "i4")]
)
_ECHO = np.dtype([("range_m", "f4"), ("amplitude", "f4"), ("owner", "i4")])
#: Whose layers a beam meets: anybody's.
_ANYBODY = np.int32(-(1 << 31))


@per_ray
def _at_least(amplitude):
    """Return the amplitude of an opaque surface: never none."""
    return amplitude if amplitude > _FAINT else _FAINTEST


@per_block
def _light_of_masks(share):
    """Return the light (2^S,) that the rays of each mask carry together."""
    light = np.zeros(1 << len(share))
    for mask in range(len(light)):
        for s in range(len(share)):
            if mask >> s & 1:
                light[mask] += share[s]
    return light


@per_ray
def _echoes(layers, count, who, share, light, left, pulse_m, found):
    """Write the echoes of one beam's layers and return how many there are.

    A beam's rays go on behind a layer as far as it lets them through. Layers within a pulse's
    length of the first of them come back as one echo, at their mean range weighed by what each
    returns.

    Args:
        layers: `_LAYER` records, nearest first.
        count: how many.
        who: owner of the layers that count, as if it were alone, or `_ANYBODY`.
        share: (S,) float64, of a beam's light that each of its rays carries.
        light: (2^S,) float64, what rays carry together, see `_light_of_masks`.
        left: (S,) float64, room for what is left of it.
        pulse_m: length of a pulse, there and back.
        found: `_ECHO` records to write.
    """
    # Before anything clear comes a ray is there or not, and what several carry is known.
    clear, free = False, len(light) - 1
    used = 0
    first, total, weighed, most = 0.0, 0.0, 0.0, 0.0
    whose = -1
    for i in range(count):
        layer = layers[i]
        if who not in (_ANYBODY, layer.owner):
            continue
        if layer.through > 0.0 and not clear:
            clear = True
            for s in range(len(share)):
                left[s] = share[s] if free >> s & 1 else 0.0
        if clear:
            reach = 0.0
            for s in range(len(share)):
                if layer.mask >> s & 1:
                    reach += left[s]
                    left[s] *= layer.through
        else:
            reach = light[free & layer.mask]
            free &= ~layer.mask
        amplitude = reach * layer.backscatter
        if amplitude <= _FAINT:
            if reach <= 1e-6 or layer.through > 0.0:
                continue
            amplitude = _FAINTEST
        if total > 0.0 and layer.range_m - first > pulse_m:
            echo = found[used]
            echo.range_m, echo.amplitude, echo.owner = weighed / total, total, whose
            used += 1
            total = 0.0
        if total == 0.0:
            first, weighed, most = layer.range_m, 0.0, 0.0
        total += amplitude
        weighed += amplitude * layer.range_m
        if amplitude > most:
            most, whose = amplitude, layer.owner
    if total > 0.0:
        echo = found[used]
        echo.range_m, echo.amplitude, echo.owner = weighed / total, total, whose
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
    layers, found = np.empty(_MOST_LAYERS, _LAYER), np.empty(_MOST_LAYERS, _ECHO)
    left = np.empty(len(share))
    used, lone = np.int64(0), np.int64(0)  # literals would compile `_write_alone` once more
    light = _light_of_masks(share)
    whole = len(light) - 1
    all_light = light[whole]
    for m in range(len(touched)):
        # What the world has there comes from far off, while beams before are combined.
        if m + 2 * _AHEAD < len(touched):
            prefetch(static.start, touched[m + 2 * _AHEAD])
            ahead = static.start[touched[m + _AHEAD]]
            prefetch(static.range_m, ahead)
            prefetch(static.backscatter, ahead)
            prefetch(static.through, ahead)
            prefetch(static.mask, ahead)
            prefetch(static.peak, ahead)
        echoes.start[m] = used
        last, still = moving.last[m], static.start[touched[m]]
        stands = static.start[touched[m] + 1] - still
        if last < 0 and _is_opaque(static, still, stands, whole):
            if stands:
                # In single precision, as where several layers are combined.
                back = np.float64(np.float32(static.backscatter[still]))
                amplitude = _at_least(all_light * back)
                _write(echoes, used, static.range_m[still], amplitude, -1 - still, static.peak)
                used += 1
            continue
        if _is_plain(static, moving, last, still, stands, whole):
            amplitude = _at_least(all_light * moving.backscatter[last])
            who, at = moving.actor[last], moving.range_m[last]
            if moving.mask[last] & ON_AXIS:
                _write_alone(alone, lone, m, who, at, amplitude)
                lone += 1
            else:
                who += BESIDE
            if stands and static.range_m[still] <= at:
                at, who = static.range_m[still], -1 - still
                amplitude = _at_least(all_light * static.backscatter[still])
            _write(echoes, used, at, amplitude, np.int64(who), static.peak)
            used += 1
            continue
        count = _layers_of(touched[m], last, static, moving, layers)
        several = _echoes(layers, count, _ANYBODY, share, light, left, pulse_m, found)
        for e in range(several):
            at, amplitude = found[e].range_m, np.float64(found[e].amplitude)
            _write(echoes, used, at, amplitude, np.int64(found[e].owner), static.peak)
            used += 1
        for i in range(count):
            who = layers[i].owner
            if who < 0 or who >= BESIDE or _is_among(who, layers, i):
                continue
            several = _echoes(layers, count, who, share, light, left, pulse_m, found)
            best, strongest = -1, 0.0
            for e in range(several):
                strength = found[e].amplitude / found[e].range_m ** 2
                if strength > strongest:
                    best, strongest = e, strength
            if best >= 0:
                at, amplitude = found[best].range_m, np.float64(found[best].amplitude)
                _write_alone(alone, lone, m, who, at, amplitude)
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
def _layers_of(beam, last, static, moving, layers):
    """Write the layers of a beam, the static world's and the actors', and return how many.

    The nearest comes first; of those as near as each other, the static world's. The ``last`` of
    the actors' leads to the others.
    """
    count = 0
    for still in range(static.start[beam], static.start[beam + 1]):
        if count < _MOST_LAYERS:
            layer = layers[_place_for(static.range_m[still], layers, count)]
            layer.range_m, layer.backscatter = static.range_m[still], static.backscatter[still]
            layer.through, layer.mask = static.through[still], static.mask[still]
            layer.owner = -1 - still
            count += 1
    met = last
    while met >= 0:
        if count < _MOST_LAYERS:
            layer = layers[_place_for(moving.range_m[met], layers, count)]
            layer.range_m, layer.backscatter = moving.range_m[met], moving.backscatter[met]
            layer.through, layer.mask = moving.through[met], moving.mask[met]
            layer.owner = moving.actor[met]
            if not moving.mask[met] & ON_AXIS:
                layer.owner += BESIDE
            count += 1
        met = moving.before[met]
    return count


@per_ray
def _place_for(range_m, layers, count):
    """Move layers that are farther than a new one back, and return its place among them."""
    place = count
    while place > 0 and layers[place - 1].range_m > range_m:
        before, layer = layers[place - 1], layers[place]
        layer.range_m, layer.backscatter = before.range_m, before.backscatter
        layer.through, layer.mask, layer.owner = before.through, before.mask, before.owner
        place -= 1
    return place


@per_ray
def _is_among(who, layers, count):
    """Return whether one of the first layers is this one's."""
    known = False
    for j in range(count):
        known = known or layers[j].owner == who
    return known


@per_ray
def _write(echoes, at, range_m, amplitude, owner, peak):
    """Write an echo, if there is room for it.

    ``peak`` (L,) belongs to the static world's layers; actors count as hit at right angles.
    """
    if at < len(echoes.range_m):
        echoes.range_m[at], echoes.amplitude[at], echoes.owner[at] = range_m, amplitude, owner
        echoes.peak[at] = peak[-1 - owner] if owner < 0 else np.float32(1.0)


@per_ray
def _write_alone(alone, at, beam, actor, range_m, amplitude):
    """Write what an actor alone would give, if there is room for it."""
    if at < len(alone.beam):
        alone.beam[at], alone.actor[at] = beam, actor
        alone.range_m[at], alone.amplitude[at] = range_m, amplitude
