"""Return mode: which of a beam's echoes a sensor reports."""

import numpy as np

from urbantwin.geometry.compiled import per_block, per_ray
from urbantwin.lidar.compiled.report import OUTLIER

__all__ = ["MODES", "choose", "settle"]

#: By number.
MODES = ("strongest", "last", "dual", "first")
_LAST, _DUAL, _FIRST = MODES.index("last"), MODES.index("dual"), MODES.index("first")


@per_block
def choose(start, strength, level, mode):
    """Return for each of M beams the echo that is reported and a second one; -1 for none.

    Strongest: that one. Last (first): the farthest (nearest) that may be noticed and, should
    it be missed, the strongest. Dual: the strongest and the farthest; where these are the same,
    the second strongest.

    Args:
        start: (M + 1,) int32, where the echoes of each beam begin, nearest first.
        strength: (E,) float32.
        level: (E,) int32, 0 of an echo that is never noticed.
        mode: number among `MODES`.
    """
    count = len(start) - 1
    first, second = np.full(count, -1, np.int32), np.full(count, -1, np.int32)
    for beam in range(count):
        best, other, last, nearest = -1, -1, -1, -1
        for echo in range(start[beam], start[beam + 1]):
            if level[echo] <= 0:
                continue
            last = echo
            if nearest < 0:
                nearest = echo
            if best < 0 or strength[echo] > strength[best]:
                best, other = echo, best
            elif other < 0 or strength[echo] > strength[other]:
                other = echo
        if mode == 0:
            first[beam] = best
        elif mode in (_LAST, _FIRST):
            first[beam] = last if mode == _LAST else nearest
            if best != first[beam]:
                second[beam] = best
        else:
            first[beam] = best
            second[beam] = last if last != best else other
    return first, second


@per_ray
def settle(detections, slots, range_m, strength, measured_m, intensity, reported, mode):
    """Put spurious echoes (A,) among detections where they win.

    A sensor that reports the strongest echo takes a spurious one for it where that is stronger; one
    that reports the last takes one that is farther, and one that reports the first a nearer one.
    One that reports two has room for it beside a single one, the stronger first, else it takes the
    place of the first if it is stronger.

    Args:
        detections: `detections.Detections`, to write.
        slots: `detections.Slots`, of the spurious echoes.
        range_m: (A,) float32, of these.
        strength: (A,) float32.
        measured_m: (A,) float32, their ranges as measured.
        intensity: (A,) float32.
        reported: (A,) float32, strength of the first detection of the same beam.
        mode: number among `MODES`.
    """
    for k in range(len(slots.beam)):
        row, echo = slots.row[k], 0
        if slots.had[k]:
            wins = strength[k] > reported[k]
            if mode == _DUAL and slots.had[k] == 1:
                if wins:
                    _move_back(detections, row)
                else:
                    row, echo = row + 1, 1
            else:
                if mode in (_LAST, _FIRST):
                    wins = (range_m[k] > detections.range_m[row]) == (mode == _LAST)
                if not wins:
                    continue
        detections.echo[row], detections.semantic[row], detections.actor[row] = echo, OUTLIER, -1
        detections.range_m[row], detections.intensity[row] = measured_m[k], intensity[k]


@per_ray
def _move_back(detections, row):
    """Make a beam's first detection its second."""
    detections.echo[row + 1] = 1
    detections.semantic[row + 1] = detections.semantic[row]
    detections.actor[row + 1] = detections.actor[row]
    detections.range_m[row + 1] = detections.range_m[row]
    detections.intensity[row + 1] = detections.intensity[row]
