"""Medians: the gap between the carriageways of a dual street, half to each of them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.roads.model import CURB_HEIGHT_M, RAISED_KINDS, LaneModel, ModelRoad, fitted
from urbantwin.roads.model.curve import all_at, aside
from urbantwin.roads.side_lanes.clearance import STEP_M
from urbantwin.roads.side_lanes.lane_insertion import Insertion

__all__ = ["medians"]

#: Gaps between carriageways that are medians, metres: less is a line, more is land.
NARROWEST_M, WIDEST_M = 0.6, 8.0
#: Shortest median, and the length of its noses, metres.
SHORTEST_M, NOSE_M = 6.0, 2.0
#: Two carriageways run beside or against each other within this angle, as a cosine.
PARALLEL = 0.8
#: Largest difference between a median's width and half of the gap, metres.
TOLERANCE_M = 0.05


def medians(
    model: LaneModel, footprints: Mapping[int, shapely.Geometry]
) -> dict[int, list[Insertion]]:
    """Return the median lanes of the streets of one direction, by road.

    A median lies on the inner side and fills half of the gap to a carriageway against it, all of
    the gap to one beside it; it narrows to a nose before the junction.

    Args:
        model: the lane model.
        footprints: the area of each street in plan, by its id.
    """
    streets = [road for road in model.roads if road.junction < 0 and _is_driven(road)]
    shapes = [footprints[road.id] for road in streets]
    # Outer roads beyond the region are ways of no map: nothing is built between them.
    roads = [road for road in streets if any(road.ways) and _inner_side(road)]
    stations = [
        np.linspace(0.0, road.length, max(3, int(road.length / STEP_M) + 2)) for road in roads
    ]
    found: dict[int, list[Insertion]] = {}
    widths = _widths(roads, stations, streets, shapes)
    for road, s, width in zip(roads, stations, widths, strict=True):
        side = _inner_side(road)
        items = [
            item for a, b in _spans(width) if (item := _median(road, side, s[a:b], width[a:b]))
        ]
        if items:
            found[road.id] = items
    return found


def _is_driven(road: ModelRoad) -> bool:
    """Whether a road is more than a footway."""
    return any(lane.kind not in RAISED_KINDS for part in road.sections for lane in part.lanes)


def _inner_side(road: ModelRoad) -> int:
    """Return the side without lanes of a road of one direction: 1, -1; 0 if it has both."""
    if any(lane.opposite for section in road.sections for lane in section.lanes):
        return 0
    ids = {lane.id > 0 for section in road.sections for lane in section.lanes}
    return 0 if len(ids) != 1 else (-1 if ids.pop() else 1)


def _widths(
    roads: Sequence[ModelRoad],
    stations: Sequence[NDArray[np.float64]],
    streets: Sequence[ModelRoad],
    shapes: Sequence[shapely.Geometry],
) -> list[NDArray[np.float64]]:
    """Return the width (N,) of each road's median at its stations (N,); nan without one."""
    if not roads:
        return []
    counts = [len(s) for s in stations]
    side, number, level = np.repeat(
        [(_inner_side(road), road.id, road.level) for road in roads], counts, axis=0
    ).T
    pose = all_at([road.curve for road in roads], stations)
    edge = np.concatenate([road.offset.at(s) for road, s in zip(roads, stations, strict=True)])
    near, far = aside(pose, edge + side * 0.02), aside(pose, edge + side * (WIDEST_M + 0.5))
    probes = shapely.linestrings(np.stack([near, far], axis=1))
    probe, hit = shapely.STRtree(shapes).query(probes, predicate="intersects")
    others = np.array([(road.id, road.level) for road in streets])[hit]
    fits = (others[:, 0] != number[probe]) & (others[:, 1] == level[probe])
    probe, hit = probe[fits], hit[fits]
    crossed = shapely.intersection(np.asarray(shapes, object)[hit], probes[probe])
    reach = shapely.distance(shapely.points(near[probe]), crossed) + 0.02
    width = np.full(len(pose), math.nan)
    order = np.lexsort((reach, probe))
    # The nearest street at each station.
    nearest = order[np.unique(probe[order], return_index=True)[1]]
    for j in np.unique(hit[nearest]):
        other, mine = streets[j], nearest[hit[nearest] == j]
        k, gap = probe[mine], reach[mine]
        heading = other.curve.at(other.curve.locate(near[k])[0])[:, 2]
        along = np.cos(heading - pose[k, 2])
        # A carriageway in the opposite direction has half of the median; a parallel one has none.
        share = np.where((along < -PARALLEL) & bool(_inner_side(other)), 0.5, 1.0)
        ok = (np.abs(along) > PARALLEL) & (gap > NARROWEST_M) & (gap < WIDEST_M)
        width[k[ok]] = (gap * share)[ok]
    return np.split(width, np.cumsum(counts)[:-1])


def _spans(width: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Return from and to of the stretches with a median."""
    known = np.concatenate([[False], np.isfinite(width), [False]])
    change = np.flatnonzero(known[1:] != known[:-1])
    return [(int(a), int(b)) for a, b in change.reshape(-1, 2)]


def _median(
    road: ModelRoad, side: int, s: NDArray[np.float64], width: NDArray[np.float64]
) -> Insertion | None:
    if len(s) < 3 or s[-1] - s[0] < SHORTEST_M:
        return None
    fine = np.linspace(0.0, float(s[-1] - s[0]), max(8, int((s[-1] - s[0]) / 0.5) + 1))
    whole = np.interp(fine, s - s[0], width)
    nose = np.clip(np.minimum(fine, fine[-1] - fine) / NOSE_M, 0.0, 1.0)
    shape = whole * nose**2 * (3 - 2 * nose)
    profile = fitted(fine, shape, tolerance=TOLERANCE_M, slopes=(0.0, 0.0))
    return Insertion(side, "reference", "median", float(s[0]), float(s[-1]), profile, CURB_HEIGHT_M)
