"""Detection over all beams of a turn, in one pass; points of what was detected.

The same in numpy takes a dozen passes over arrays of a quarter of a million beams; it is what a
frame mostly costs where few actors are near.
"""

import numpy as np

from urbantwin.geometry.compiled import per_ray
from urbantwin.lidar.compiled.echoes import BESIDE
from urbantwin.taxonomy import semantic_id

__all__ = ["OUTLIER", "detect", "write_points"]

#: Class of a point between an actor and what is behind it, which belongs to neither.
OUTLIER = np.uint16(semantic_id("outlier"))


@per_ray
def detect(answers, echoes, layer_class, draws, step_m, both, out):
    """Return how many detections there are, in the order of beams, and write them.

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
    """
    alone, other, also = answers.first, answers.other, answers.second
    place, first_of, second_of, owner = echoes.place, echoes.first, echoes.second, echoes.owner
    detection, noise = draws.first.detection, draws.first.noise
    detection_2, noise_2 = draws.second.detection, draws.second.noise
    dead, quantiles = draws.dead, draws.quantiles
    count = 0
    for beam in range(len(place)):
        if len(dead) and dead[beam]:
            continue
        touched = place[beam]
        reported = 0
        for turn in range(2):
            if turn == 1 and reported == 1 and not both:
                break
            if turn == 1 and both:
                drawn, jitter = detection_2[beam], noise_2[beam]
            else:
                drawn, jitter = detection[beam], noise[beam]
            if touched < 0:
                if turn == 0:
                    if drawn >= alone.level[beam]:
                        continue
                    at, wide = alone.range_m[beam], alone.sigma[beam]
                    bright, kind = alone.intensity[beam], alone.semantic[beam]
                else:
                    n = other[beam]
                    if n < 0 or drawn >= also.level[n]:
                        break
                    at, wide = also.range_m[n], also.sigma[n]
                    bright, kind = also.intensity[n], also.semantic[n]
                source, actor = -1, -1
            else:
                source = first_of[touched] if turn == 0 else second_of[touched]
                if source < 0 or drawn >= echoes.level[source]:
                    continue
                at, wide = echoes.range_m[source], echoes.sigma[source]
                bright, kind, actor = echoes.intensity[source], np.uint16(0), -1
                if owner[source] < 0:
                    kind = layer_class[-1 - owner[source]]
                elif owner[source] >= BESIDE:
                    kind = OUTLIER
                else:
                    actor = owner[source]
            out.beam[count], out.echo[count], out.source[count] = beam, reported, source
            out.semantic[count], out.intensity[count], out.actor[count] = kind, bright, actor
            if actor < 0:
                at = at + wide * quantiles[jitter]
                if step_m > 0:
                    at = np.float32(np.rint(at / step_m)) * step_m
            out.range_m[count] = at
            reported += 1
            count += 1
    return count


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
    count = len(column_s)
    moving = origin.shape[1] > 1
    ring, first = 0, 0
    for m in range(len(beam)):
        n = beam[m]
        if not first <= n < first + count:
            ring = n // count
            first = ring * count
        column = n - first
        k = column if moving else 0
        for axis in range(3):
            points[m, axis] = directions[axis, n] * range_m[m] + origin[axis, k]
        points[m, 3] = intensity[m]
        rings[m], columns[m] = ring, column
        times[m] = column_s[column] + ring_s[ring]
