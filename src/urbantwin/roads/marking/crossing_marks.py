"""What crossings are marked with: stripes, two lines, two broken lines, two rows of studs."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import shapely
import shapely.ops
from numpy.typing import NDArray

from urbantwin.geometry import moved_left
from urbantwin.roads.marking.zebra import zebra
from urbantwin.roads.network import Lane

__all__ = ["crossing_marks"]

#: Width, length of a mark and from one to the next, metres. Lines: US MUTCD 3B.18 (6 to 24 inches);
#: dashes: German RMS 1 (0.12 m, 0.5 m painted, 0.2 m bare); dots: UK TSRGD, schedule 14 (studs of
#: about 0.1 m, 0.25 to 0.72 m apart).
BORDERS = {"lines": (0.3, 0.0, 0.0), "dashes": (0.12, 0.5, 0.7), "dots": (0.1, 0.1, 0.5)}


def crossing_marks(lane: Lane) -> tuple[str, list[NDArray[np.float64]]]:
    """Return the kind of paint of a crossing, and its quadrilaterals, (4, 2) each, site frame.

    A crossing of which nobody told has stripes.
    """
    if lane.marking == "none":
        return "crossing", []
    if lane.marking not in BORDERS:
        return "zebra", zebra(lane)
    width, mark, period = BORDERS[lane.marking]
    quads = []
    for side in (-1, 1):
        border = shapely.LineString(moved_left(lane.centre[:, :2], side * (lane.width - width) / 2))
        count = int((border.length + period - mark) // period) if period else 1
        margin = (border.length - (count - 1) * period - mark) / 2 if period else 0.0
        for number in range(count):
            at = margin + number * period
            piece = shapely.ops.substring(border, at, at + (mark or border.length))
            points = shapely.get_coordinates(piece)
            for a, b in pairwise(points):
                across = np.array([a[1] - b[1], b[0] - a[0]])
                across *= width / 2 / max(float(np.linalg.norm(across)), 1e-9)
                quads.append(np.array([a - across, b - across, b + across, a + across]))
    return "crossing", quads
