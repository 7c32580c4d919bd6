"""From the layers that a beam meets to the echoes that come back."""

import numpy as np
from numba import njit

from urbantwin.lidar.compiled.layers import ON_AXIS

__all__ = ["BESIDE", "MOST_LAYERS", "combine"]

#: Added to the actor that owns an echo along a beam whose axis passes beside the actor: the point
#: that is reported lies on the axis, and so beside the actor.
BESIDE = 1 << 20

#: A beam with more layers than this loses the farthest.
MOST_LAYERS = 128
#: Amplitude below which a surface is as good as none, unless nothing passes through it.
_FAINT = 1e-7
#: Black, or met edge on: it is there, however faint.
_FAINTEST = 1e-9


@njit(cache=True, nogil=True)
def _at_least(amplitude):
    """Return the amplitude of an opaque surface: never none."""
    return amplitude if amplitude > _FAINT else _FAINTEST


@njit(cache=True, nogil=True)
def _echoes(count, range_m, back, through, mask, owner, order, share, left, pulse_m, echoes, at):
    """Write the echoes of one beam's layers and return how many there are.

    A beam's rays go on behind a layer as far as it lets them through. Layers within a pulse's
    length of the first of them come back as one echo, at their mean range weighed by what each
    returns.
    """
    out_range, out_amplitude, out_owner = echoes
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


@njit(cache=True, nogil=True)
def combine(touched, static, moving, share, pulse_m, room, echoes, alone):
    """Combine the static world's layers with the actors' along the beams that touch actors.

    Args:
        touched: (M,) int32 beams.
        static: first layer of each beam (N + 1,) int64 and the layers: range float32, backscatter
            float32, share let through float32, mask uint8. May have no layers and N of 0: nothing
            stands in the way.
        moving: for each beam its last layer (N,) int32, -1 for none, and the layers: the one
            before along the same beam int32, actor int32, range, backscatter, let through, mask.
        share: (S,) float64, of a beam's light that each of its rays carries.
        pulse_m: length of a pulse, there and back.
        room: scratch of ``MOST_LAYERS``: range, backscatter, let through, mask, owner, order; a
            second one; and what is left of the rays (S,).
        echoes: first echo (M + 1,) int32, range (E,) float32, amplitude (E,) float32, owner (E,)
            int32: an actor, `BESIDE` plus one, or ``-1 - layer`` of the static world; to write.
        alone: beam (L,) int32 (its number in ``touched``), actor (L,) int32, range (L,) float32,
            amplitude (L,) float32 of the strongest echo that each actor alone would give
            along beams whose axes pass through it.

    Returns:
        How many echoes and how many echoes of actors alone there are; written while there is room.
    """
    start, static_range, static_back, static_through, static_mask = static
    head, before, actor, range_m, back, through, mask = moving
    own, single, left = room
    first, echo_range, echo_amplitude, echo_owner = echoes
    alone_beam, alone_actor, alone_range, alone_amplitude = alone
    found = (echo_range, echo_amplitude, echo_owner)
    one_range = np.empty(MOST_LAYERS, np.float32)
    one_amplitude = np.empty(MOST_LAYERS, np.float32)
    one_owner = np.empty(MOST_LAYERS, np.int32)
    used, lone = 0, 0
    whole = (1 << len(share)) - 1
    light = 0.0
    for s in range(len(share)):
        light += share[s]
    for m in range(len(touched)):
        beam = touched[m]
        count = 0
        # Nearly all beams: one opaque surface of one actor before, or behind, one of the world's.
        last = head[beam]
        still, stands = -1, 0
        if len(start) > 1:
            still, stands = start[beam], start[beam + 1] - start[beam]
        if (
            last >= 0
            and stands <= 1
            and before[last] < 0
            and through[last] == 0.0
            and mask[last] & whole == whole
            and (
                stands == 0
                or (static_through[still] == 0.0 and static_mask[still] & whole == whole)
            )
        ):
            first[m] = used
            amplitude = _at_least(light * back[last])
            who = actor[last]
            if mask[last] & ON_AXIS:
                if lone < len(alone_beam):
                    alone_beam[lone], alone_actor[lone] = m, who
                    alone_range[lone], alone_amplitude[lone] = range_m[last], amplitude
                lone += 1
            else:
                who += BESIDE
            at = range_m[last]
            if stands and static_range[still] <= at:
                at, who = static_range[still], -1 - still
                amplitude = _at_least(light * static_back[still])
            if used < len(echo_range):
                echo_range[used], echo_amplitude[used], echo_owner[used] = at, amplitude, who
            used += 1
            continue
        if len(start) > 1:
            for layer in range(start[beam], start[beam + 1]):
                if count < MOST_LAYERS:
                    own[0][count], own[1][count] = static_range[layer], static_back[layer]
                    own[2][count], own[3][count] = static_through[layer], static_mask[layer]
                    own[4][count] = -1 - layer
                    count += 1
        layer = head[beam]
        while layer >= 0:
            if count < MOST_LAYERS:
                own[0][count], own[1][count] = range_m[layer], back[layer]
                own[2][count], own[3][count] = through[layer], mask[layer]
                own[4][count] = actor[layer]
                if not mask[layer] & ON_AXIS:
                    own[4][count] += BESIDE
                count += 1
            layer = before[layer]
        first[m] = used
        used += _echoes(
            count, own[0], own[1], own[2], own[3], own[4], own[5], share, left, pulse_m, found, used
        )
        # Each actor alone, once: where its layers begin in the list.
        for i in range(count):
            who = own[4][i]
            if who < 0 or who >= BESIDE:
                continue
            known = False
            for j in range(i):
                known = known or own[4][j] == who
            if known:
                continue
            few = 0
            for j in range(i, count):
                if own[4][j] == who:
                    single[0][few], single[1][few] = own[0][j], own[1][j]
                    single[2][few], single[3][few] = own[2][j], own[3][j]
                    single[4][few] = who
                    few += 1
            several = _echoes(
                few, single[0], single[1], single[2], single[3], single[4], single[5], share,
                left, pulse_m, (one_range, one_amplitude, one_owner), 0,
            )  # fmt: skip
            best, strongest = -1, 0.0
            for e in range(min(several, MOST_LAYERS)):
                strength = one_amplitude[e] / one_range[e] ** 2
                if strength > strongest:
                    best, strongest = e, strength
            if best >= 0:
                if lone < len(alone_beam):
                    alone_beam[lone], alone_actor[lone] = m, who
                    alone_range[lone], alone_amplitude[lone] = one_range[best], one_amplitude[best]
                lone += 1
    first[len(touched)] = used
    return used, lone
