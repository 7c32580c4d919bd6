"""Detection over all beams of a turn, in one pass; points of what was detected.

The same in numpy takes a dozen passes over arrays of a quarter of a million beams; it is what a
frame mostly costs where few actors are near.
"""

import numpy as np

from urbantwin.geometry.compiled import per_ray
from urbantwin.lidar.compiled.echoes import BESIDE
from urbantwin.taxonomy import semantic_id

__all__ = ["OUTLIER", "detect", "quantised", "write_points"]

#: SemanticKITTI's class of points that belong to no object: rain, snow, fog, stray light, and what
#: lies between an actor and what is behind it.
OUTLIER = np.uint16(semantic_id("outlier"))


@per_ray
def detect(answers, echoes, layer_class, draws, step_m, both, out, touching, slots):
    """Write the detections in the order of beams, and which are of beams that touch actors.

    Where a spurious echo has room among those of its beam, a row is left out for it.

    Args:
        answers: `static_view.StaticAnswers`: what each of N beams would report if it touched no
            actor.
        echoes: `echoes.Echoes` along the beams that touch actors.
        layer_class: (L,) uint16, class of each layer of the static world.
        draws: `returns.draws.TurnDraws`.
        step_m: float32, step that ranges are rounded to; 0 for none.
        both: whether the second echo is reported too, or only where the first is missed.
        out: `detections.Detections` to write, (2 N,) or (N,): ranges with noise (but not those of
            actors).
        touching: `detections.Touching` to write, (2 M,) or (M,).
        slots: `detections.Slots`: beams of spurious echoes, and what is to be written of them.

    Returns:
        How many detections there are, and how many of beams that touch actors.
    """
    alone, other, also = answers.first, answers.other, answers.second
    touched, owner = echoes.beam, echoes.owner
    detection, noise = draws.first.detection, draws.first.noise
    detection_2, noise_2 = draws.second.detection, draws.second.noise
    dead, quantiles = draws.dead, draws.quantiles
    # Of an index with a sign numba asks whether it counts from the end, which costs a third.
    count, begin, end = np.uint64(0), np.uint64(0), np.uint64(len(detection))
    used, m, k = 0, 0, 0
    while begin < end:
        touch = np.uint64(touched[m]) if m < len(touched) else end
        stray = np.uint64(slots.beam[k]) if k < len(slots.beam) else end
        if touch > stray:  # That comes first, along a beam that touches nothing.
            touch = end
        for beam in range(begin, min(touch, stray + np.uint64(1), end)):
            if len(dead) and dead[beam]:
                continue
            seen = detection[beam] < alone.level[beam]
            if seen:
                at = _measured(alone, beam, quantiles[noise[beam]], step_m)
                _write(out, count, beam, 0, alone.semantic[beam], alone.intensity[beam], -1, at)
                count += np.uint64(1)
            if len(also.level) and other[beam] >= 0 and (both or not seen):
                n = np.uint64(other[beam])
                if detection_2[beam] < also.level[n]:
                    at = _measured(also, n, quantiles[noise_2[beam]], step_m)
                    bright = also.intensity[n]
                    _write(out, count, beam, np.int64(seen), also.semantic[n], bright, -1, at)
                    count += np.uint64(1)
        begin = min(touch, stray) + np.uint64(1)
        turns, reported = 0, 0
        if touch < end:
            m += 1
            turns = 0 if len(dead) and dead[touch] else 2
        for turn in range(turns):
            source = echoes.first[m - 1] if turn == 0 else echoes.second[m - 1]
            drawn = detection[touch] if turn == 0 else detection_2[touch]
            if source < 0 or drawn >= echoes.level[source] or (reported and not both):
                continue
            kind, actor, at = np.uint16(0), -1, echoes.range_m[source]
            if 0 <= owner[source] < BESIDE:
                actor = owner[source]
            else:
                kind = OUTLIER if owner[source] >= 0 else layer_class[-1 - owner[source]]
                jitter = noise[touch] if turn == 0 else noise_2[touch]
                at = _measured(echoes, source, quantiles[jitter], step_m)
            _write(out, count, touch, reported, kind, echoes.intensity[source], actor, at)
            touching.row[used], touching.sigma[used] = count, echoes.sigma[source]
            touching.amplitude[used] = echoes.amplitude[source]
            used += 1
            reported += 1
            count += np.uint64(1)
        if stray < min(begin, end):
            had = 0
            while had < count and out.beam[count - np.uint64(had + 1)] == stray:
                had += 1
            slots.row[k], slots.had[k] = count - np.uint64(had), had
            if had < (2 if both else 1):
                out.beam[count] = stray
                count += np.uint64(1)
            k += 1
    return count, used


@per_ray
def _measured(echoes, n, jitter, step_m):
    """Return the range of an echo with noise, in the sensor's steps."""
    return quantised(echoes.range_m[n] + echoes.sigma[n] * jitter, step_m)


@per_ray
def quantised(range_m, step_m):
    """Return a range (float32) in the sensor's steps; as it is where these are 0."""
    return np.float32(np.rint(range_m / step_m)) * step_m if step_m > 0 else range_m


@per_ray
def _write(out, count, beam, echo, kind, bright, actor, at):
    """Write a detection."""
    out.beam[count], out.echo[count], out.actor[count] = beam, echo, actor
    out.semantic[count], out.intensity[count], out.range_m[count] = kind, bright, at


@per_ray
def write_points(detections, directions, origin, column_s, ring_s, out):
    """Write where beams end, which they are, and when they fired.

    Args:
        detections: `detections.Detections`, best in ascending order of beams.
        directions: (3, N) float32, frame of the points.
        origin: (3, K) float32, where each column's beams leave, or (3, 1).
        column_s: (K,) float64, when columns fire, seconds.
        ring_s: (C,) float64, how much later each channel does.
        out: `turn.Points` to write.
    """
    beam, range_m, intensity = detections.beam, detections.range_m, detections.intensity
    points, rings, columns, times = out
    count = np.uint64(len(column_s))
    moving = origin.shape[1] > 1
    ring, first = np.uint64(0), np.uint64(0)
    for m in range(len(beam)):
        n = np.uint64(beam[m])
        if not first <= n < first + count:
            ring = n // count
            first = ring * count
        column = n - first
        k = column if moving else np.uint64(0)
        for axis in range(3):
            points[m, axis] = directions[axis, n] * range_m[m] + origin[axis, k]
        points[m, 3] = intensity[m]
        rings[m], columns[m] = ring, column
        times[m] = column_s[column] + ring_s[ring]
