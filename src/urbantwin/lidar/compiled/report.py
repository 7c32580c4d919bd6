"""Detection over all beams of a turn, in one pass; points of what was detected.

The same in numpy takes a dozen passes over arrays of a quarter of a million beams; it is what a
frame mostly costs where few actors are near.
"""

import numpy as np

from urbantwin.geometry.compiled import per_ray
from urbantwin.lidar.compiled.echoes import BESIDE
from urbantwin.taxonomy import semantic_id

__all__ = ["OUTLIER", "detect", "merge", "write_points"]

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
        if touched < 0 and not both:
            # Most beams: they touch no actor, and report one echo.
            drawn, jitter = detection[beam], noise[beam]
            if drawn < alone.level[beam]:
                at = _measured(alone, beam, quantiles[jitter], step_m)
                _write(out, count, beam, 0, -1, alone.semantic[beam], alone.intensity[beam], -1, at)
                count += 1
            elif other[beam] >= 0 and drawn < also.level[other[beam]]:
                n = other[beam]
                at = _measured(also, n, quantiles[jitter], step_m)
                _write(out, count, beam, 0, -1, also.semantic[n], also.intensity[n], -1, at)
                count += 1
            continue
        reported = 0
        for turn in range(2):
            if turn == 1 and reported == 1 and not both:
                break
            if turn == 1 and both:
                drawn, jitter = detection_2[beam], noise_2[beam]
            else:
                drawn, jitter = detection[beam], noise[beam]
            if touched < 0:
                report, n = alone, np.int64(beam)
                if turn == 1:
                    report, n = also, np.int64(other[beam])
                if n < 0 or drawn >= report.level[n]:
                    continue
                at = _measured(report, n, quantiles[jitter], step_m)
                kind, bright = report.semantic[n], report.intensity[n]
                _write(out, count, beam, reported, -1, kind, bright, -1, at)
            else:
                source = first_of[touched] if turn == 0 else second_of[touched]
                if source < 0 or drawn >= echoes.level[source]:
                    continue
                kind, actor, at = np.uint16(0), -1, echoes.range_m[source]
                if owner[source] >= 0 and owner[source] < BESIDE:
                    actor = owner[source]
                else:
                    kind = OUTLIER if owner[source] >= 0 else layer_class[-1 - owner[source]]
                    at = _measured(echoes, source, quantiles[jitter], step_m)
                bright = echoes.intensity[source]
                _write(out, count, beam, reported, source, kind, bright, actor, at)
            reported += 1
            count += 1
    return count


@per_ray
def _measured(echoes, n, jitter, step_m):
    """Return the range of an echo with noise, in the sensor's steps."""
    at = echoes.range_m[n] + echoes.sigma[n] * jitter
    if step_m > 0:
        at = np.float32(np.rint(at / step_m)) * step_m
    return at


@per_ray
def _write(out, count, beam, echo, source, kind, bright, actor, at):
    """Write a detection."""
    out.beam[count], out.echo[count], out.source[count] = beam, echo, source
    out.semantic[count], out.intensity[count], out.actor[count] = kind, bright, actor
    out.range_m[count] = at


@per_ray
def merge(detections, added, inserted, out):
    """Write detections with some of A more among them.

    Args:
        detections: `detections.Detections`, M.
        added: A more.
        inserted: `returns.added.Inserted`: which, and where they go.
        out: `detections.Detections` to write, (M',).
    """
    number, row, fresh = inserted
    first, at = 0, 0
    for k in range(len(number)):
        _copy(detections, first, row[k], out, at)
        at += row[k] - first
        _copy(added, number[k], number[k] + 1, out, at)
        at += 1
        first = row[k] if fresh[k] else row[k] + 1
    _copy(detections, first, len(detections.beam), out, at)
    beam, echo = out.beam, out.echo
    for n in range(len(beam)):
        echo[n] = 1 if n > 0 and beam[n] == beam[n - 1] else 0


@per_ray
def _copy(given, first, until, out, at):
    """Copy rows of detections, but for their numbers among those of their beams."""
    _copy_column(given.beam, first, until, out.beam, at)
    _copy_column(given.source, first, until, out.source, at)
    _copy_column(given.actor, first, until, out.actor, at)
    _copy_column(given.semantic, first, until, out.semantic, at)
    _copy_column(given.range_m, first, until, out.range_m, at)
    _copy_column(given.intensity, first, until, out.intensity, at)


@per_ray
def _copy_column(given, first, until, out, at):
    """Copy a part of an array; numba sees that the parts' indices are not negative."""
    here, there = given[first:until], out[at : at + until - first]
    for n in range(len(here)):
        there[n] = here[n]


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
