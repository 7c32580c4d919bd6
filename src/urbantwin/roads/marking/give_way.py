"""Give-way lines (triangles) and lines between parking bays, implied by the lane model."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from urbantwin.roads.marking.lines import MOTOR
from urbantwin.roads.model import LaneModel, LaneSection, ModelRoad, SectionLane

__all__ = ["GIVE_WAY", "bay_length", "parking_bays", "teeth"]

#: Numbers of the give-way sign in the catalogues of Germany, the USA and the Vienna Convention.
GIVE_WAY = frozenset({"205", "R1-2", "B1"})
#: Triangles of give-way lines: width, length, spacing, and distance before the end of the road,
#: metres (US MUTCD 3B.16: 0.3 to 0.6 m wide, half as long again, 0.1 to 0.3 m apart).
TOOTH_M, LONG_M, EVERY_M, BEFORE_M = 0.5, 0.7, 0.75, 0.6
#: Minimum width of a parking lane with perpendicular bays, metres (German RASt 06, 6.1.5).
ACROSS_M = 3.5
#: Length along the road of a parallel and of a perpendicular bay, and minimum width of a lane with
#: bays, metres.
BAY_ALONG_M, BAY_ACROSS_M, NARROWEST_M = 6.0, 2.5, 1.6


def teeth(model: LaneModel) -> Iterator[tuple[int, list[NDArray[np.float64]]]]:
    """Yield level and triangles (4, 2) of each give-way line, pointing at the waiting traffic.

    Traffic waits before a junction: the line for a sign on a connecting road lies at the end of the
    street that leads to it.
    """
    drawn: set[tuple[int, bool, int]] = set()
    for sign in model.signals:
        road = model.road_by_id.get(sign.road)
        if sign.dynamic or sign.type not in GIVE_WAY or road is None:
            continue
        forward = sign.orientation != "-"
        section = road.section_at(sign.s if road.junction >= 0 else road.length * forward)
        lanes = {
            lane.id
            for lane in section.directed
            if lane.kind in MOTOR
            and lane.forward == forward
            and (not sign.lanes or lane.id in sign.lanes)
        }
        street = _street_before(model, road, lanes, forward=forward)
        if street is None:
            continue
        road, lanes, forward = street
        ahead = 1.0 if forward else -1.0
        base = road.length - BEFORE_M if forward else BEFORE_M
        section = road.section_at(base)
        for lane in section.directed:
            key = (road.id, forward, lane.id)
            is_yielding = lane.id in lanes and lane.kind in MOTOR and lane.forward == forward
            if is_yielding and key not in drawn and road.length >= 4 * LONG_M:
                drawn.add(key)
                yield road.level, _row(road, section, lane, base, ahead)


def _street_before(
    model: LaneModel, road: ModelRoad, lanes: set[int], *, forward: bool
) -> tuple[ModelRoad, set[int], bool] | None:
    """Return the street whose traffic uses lanes of a road, with its lanes and their direction.

    A street is returned unchanged. A connecting road is followed back against the traffic; ``None``
    if no street leads to it.
    """
    seen: set[int] = set()
    while road.junction >= 0:
        link = road.predecessor if forward else road.successor
        first = road.sections[0 if forward else -1]
        back = {
            lane.predecessor if forward else lane.successor
            for lane in first.lanes
            if lane.id in lanes or len(road.sections) > 1
        }
        seen.add(road.id)
        if link is None or link.element != "road" or link.id in seen:
            return None
        road, forward = model.road_by_id[link.id], link.contact == "end"
        last = road.sections[-1 if forward else 0]
        lanes = {number for number in back if number is not None and number in last.by_id}
        lanes = lanes or {lane.id for lane in last.directed if lane.forward == forward}
    return road, lanes, forward


def _row(
    road: ModelRoad, section: LaneSection, lane: SectionLane, base: float, ahead: float
) -> list[NDArray[np.float64]]:
    ends = [float(road.border(section, lane, base, outer=outer)[0]) for outer in (False, True)]
    low, high = min(ends), max(ends)
    count = max(1, int((high - low - TOOTH_M) // EVERY_M) + 1)
    middle = (low + high) / 2 + EVERY_M * (np.arange(count) - (count - 1) / 2)
    s = np.tile([base, base, base - ahead * LONG_M], count)
    t = (middle[:, None] + np.array([-0.5, 0.5, 0.0]) * TOOTH_M).ravel()
    corners = road.place(s, t)[:, :2].reshape(count, 3, 2)
    return list(corners[:, [0, 1, 2, 2]] if ahead < 0 else corners[:, [1, 0, 2, 2]])


def bay_length(stands: str, widest: float) -> tuple[float, bool]:
    """Return a bay's length along the road, metres, and whether it is slanted by 45 degrees.

    Args:
        stands: orientation of parked vehicles, as ``SectionLane.parking``.
        widest: maximum width of the lane, metres.
    """
    if widest < ACROSS_M:  # half of a bay on the sidewalk does not count as one
        return BAY_ALONG_M, False
    slanted = stands == "diagonal"
    return BAY_ACROSS_M * math.sqrt(2.0 if slanted else 1.0), slanted


def parking_bays(model: LaneModel) -> Iterator[tuple[int, NDArray[np.float64]]]:
    """Yield level and ends (2, 2) of each line between two bays."""
    for road in model.roads:
        if road.junction >= 0:
            continue
        for section, end in zip(road.sections, road.section_ends, strict=True):
            for lane in section.lanes:
                if lane.kind == "parking":
                    for line in _bays(road, section, lane, end):
                        yield road.level, line


def _bays(
    road: ModelRoad, section: LaneSection, lane: SectionLane, end: float
) -> NDArray[np.float64]:
    """Return the ends (N, 2, 2) of the lines across a parking lane, evenly spaced."""
    fine = np.arange(section.s, end, 0.5)
    is_wide = lane.width.at(fine - section.s) >= NARROWEST_M
    if not is_wide.any():
        return np.zeros((0, 2, 2))
    first, last = fine[is_wide][0], fine[is_wide][-1]
    widest = float(lane.width.at(fine - section.s).max())
    length, slanted = bay_length(lane.parking, widest)
    # Slanted lines end this much farther along the traffic than they begin.
    lean = widest if slanted else 0.0
    count = int((last - first - lean) // length)
    if count < 1 and slanted:
        return np.zeros((0, 2, 2))
    s = (first + last) / 2 + length * (np.arange(count + 1) - count / 2)
    lean *= 0.5 if lane.forward else -0.5
    # Where the lane tapers a slanted line would be distorted.
    least = 0.9 * widest if slanted else NARROWEST_M
    full_width = [lane.width.at(s + shift - section.s) >= least for shift in (-lean, lean)]
    s = s[np.logical_and(*full_width)]
    ends = [
        road.place(stations, road.border(section, lane, stations, outer=outer))[:, :2]
        for outer, stations in ((False, s - lean), (True, s + lean))
    ]
    return np.stack(ends, axis=1)
