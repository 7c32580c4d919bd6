"""Medians: what lies between the carriageways of a dual street, half to each of them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.roads.model import LaneModel, ModelRoad, fitted
from urbantwin.roads.side_lanes.insertion import Insertion
from urbantwin.roads.side_lanes.room import STEP_M, footprint

__all__ = ["CURB_M", "medians"]

#: Gaps between carriageways that are medians, metres: less is a line, more is land.
NARROWEST_M, WIDEST_M = 0.6, 8.0
#: Height of curbs, metres (AASHTO Green Book: vertical curbs 0.10 to 0.20 m).
CURB_M = 0.15
#: Shortest median, and the length of its noses, metres.
SHORTEST_M, NOSE_M = 6.0, 2.0
#: Two carriageways run against each other within this angle, as a cosine.
AGAINST = -0.8
#: Largest difference between a median's width and half of the gap, metres.
TOLERANCE_M = 0.05


def medians(model: LaneModel) -> dict[int, list[Insertion]]:
    """Return the median lanes of the streets of one direction, by road.

    A median fills half of the gap to the carriageway against it, on the inner side; it narrows to
    a nose before the junction.
    """
    single = [road for road in model.roads if road.junction < 0 and _inner_side(road)]
    shapes = [footprint(road) for road in single]
    tree = shapely.STRtree(shapes)
    found: dict[int, list[Insertion]] = {}
    for road in single:
        side = _inner_side(road)
        s = np.linspace(0.0, road.length, max(3, int(road.length / STEP_M) + 2))
        gap = _gaps(road, side, s, single, shapes, tree)
        items = [item for a, b in _spans(gap) if (item := _median(road, side, s[a:b], gap[a:b]))]
        if items:
            found[road.id] = items
    return found


def _inner_side(road: ModelRoad) -> int:
    """Return the side without lanes of a road of one direction: 1, -1; 0 if it has both."""
    ids = {lane.id > 0 for section in road.sections for lane in section.lanes}
    return 0 if len(ids) != 1 else (-1 if ids.pop() else 1)


def _gaps(
    road: ModelRoad,
    side: int,
    s: NDArray[np.float64],
    single: Sequence[ModelRoad],
    shapes: Sequence[shapely.Geometry],
    tree: shapely.STRtree,
) -> NDArray[np.float64]:
    """Return the distance (N,) to the carriageway against this one; nan where there is none."""
    pose = road.curve.at(s)
    near = road.curve.beside(s, side * 0.02 + road.offset.at(s))
    far = road.curve.beside(s, side * (WIDEST_M + 0.5) + road.offset.at(s))
    probes = shapely.linestrings(np.stack([near, far], axis=1))
    gap = np.full(len(s), math.nan)
    for k, j in tree.query(probes, predicate="intersects").T.tolist():
        other = single[j]
        if other.id == road.id or other.level != road.level:
            continue
        reach = float(shapely.distance(shapely.Point(near[k]), shapes[j] & probes[k])) + 0.02
        if reach >= gap[k]:
            continue
        heading = float(other.curve.at(other.curve.locate(near[k])[0])[0, 2])
        if math.cos(heading - float(pose[k, 2])) < AGAINST:
            gap[k] = reach
    gap[(gap < NARROWEST_M) | (gap > WIDEST_M)] = math.nan
    return gap


def _spans(gap: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Return from and to of the stretches of known gaps."""
    known = np.concatenate([[False], np.isfinite(gap), [False]])
    change = np.flatnonzero(known[1:] != known[:-1])
    return [(int(a), int(b)) for a, b in change.reshape(-1, 2)]


def _median(
    road: ModelRoad, side: int, s: NDArray[np.float64], gap: NDArray[np.float64]
) -> Insertion | None:
    if len(s) < 3 or s[-1] - s[0] < SHORTEST_M:
        return None
    fine = np.linspace(0.0, float(s[-1] - s[0]), max(8, int((s[-1] - s[0]) / 0.5) + 1))
    half = np.interp(fine, s - s[0], gap) / 2
    nose = np.clip(np.minimum(fine, fine[-1] - fine) / NOSE_M, 0.0, 1.0)
    width = fitted(fine, half * nose**2 * (3 - 2 * nose), tolerance=TOLERANCE_M, slopes=(0.0, 0.0))
    return Insertion(side, "reference", "median", float(s[0]), float(s[-1]), width, CURB_M)
