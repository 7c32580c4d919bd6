"""Closed loop of an imported map: outer roads connect exits of the region to entries.

Where a street is cut, or has a free end, its outgoing lanes lead through a turnaround to its
incoming lanes. Those of a one-way street lead to the nearest incoming one-way street. Outer roads
are ordinary one-way streets with as many lanes as lead out.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.roads.imported.crop import part_of_road
from urbantwin.roads.imported.lane_links import allowed
from urbantwin.roads.imported.plain_xml import OUTER
from urbantwin.roads.loop.dubins import BUS_RADIUS_M, Pose2, dubins_path
from urbantwin.roads.model import (
    Connection,
    Curve,
    LaneModel,
    LaneSection,
    ModelJunction,
    ModelRoad,
    Profile,
    RoadLink,
    SectionLane,
    splined,
)

__all__ = ["closed_model"]

#: Ends within this distance of the region's border were cut there, by the crop or in the map,
#: metres.
CUT_M = 5.0
#: Clearance of the straight extension of a free end, metres.
ROOM_M = 3.0
#: Maximum distance of one-way ends that are the two carriageways of one street, metres.
NEAR_M = 40.0
#: Roads round the region: bend radius, distance from all streets, and from each other, metres.
RING_RADIUS_M, RING_GAP_M, RING_STEP_M = 25.0, 30.0, 8.0
#: Spacing of the points of a road round the region, metres.
STEP_M = 10.0
FAR_M = 5000.0
#: Length of the connecting roads between a street and its turnaround, metres.
MOUTH_M = 8.0
#: Speed limit of outer roads, m/s.
OUTER_MS = 30 / 3.6
MOTOR = ("driving", "bus")


@dataclass(frozen=True)
class _End:
    """A free end of a street.

    Attributes:
        road: the street.
        end: ``start`` or ``end``.
        point: (2,) its position, site frame, metres.
        heading: outwards, radians.
        leaving: ids of the outgoing lanes, from the middle of the street outwards.
        entering: ids of the incoming lanes.
    """

    road: ModelRoad
    end: str
    point: NDArray[np.float64]
    heading: float
    leaving: tuple[int, ...]
    entering: tuple[int, ...]

    @property
    def s(self) -> float:
        """Station of the end, metres."""
        return 0.0 if self.end == "start" else self.road.length

    @property
    def section(self) -> LaneSection:
        """The lane section at the end."""
        return self.road.sections[0 if self.end == "start" else -1]

    def width(self, lane: int) -> float:
        """Return a lane's width at the end, metres."""
        return float(self.section.by_id[lane].width.at([self.s - self.section.s])[0])

    def inner(self, lane: int) -> tuple[Pose2, float, float]:
        """Return the border of a lane towards the middle of the street.

        Returns:
            Its position with the heading of the traffic, its height (metres), and the rise per
                metre to the left of the traffic.
        """
        item = self.section.by_id[lane]
        border_t = float(self.road.border(self.section, item, self.s, outer=True)[0])
        t = float(self.road.border(self.section, item, self.s, outer=False)[0])
        x, y, z = self.road.place(self.s, t)[0]
        along = float(self.road.curve.at([self.s])[0, 2])
        fall = (z - float(self.road.place(self.s, border_t)[0, 2])) / (t - border_t)
        if item.forward:
            return (float(x), float(y), along), float(z), float(fall)
        return (float(x), float(y), along + math.pi), float(z), -float(fall)


def closed_model(model: LaneModel, region: shapely.Polygon) -> tuple[LaneModel, dict[str, int]]:
    """Return the model with roads from each exit to an entry, and their numbers by kind.

    Args:
        model: the lane model, cut to the region.
        region: the region, site frame.
    """
    ends = _loose_ends(model, region)
    two_way = [end for end in ends if end.leaving and end.entering]
    exits = [end for end in ends if end.leaving and not end.entering]
    entries = [end for end in ends if end.entering and not end.leaving]
    adjacent = _close_pairs(exits, entries)
    unpaired = (
        [a for a in exits if all(a is not b for b, _ in adjacent)],
        [a for a in entries if all(a is not b for _, b in adjacent)],
    )
    round_it = _round(*unpaired)
    builder = _Builder(model)
    for end in two_way:
        builder.turn_round(end)
    for exit_, entry in adjacent:
        builder.lead_over(exit_, entry, None)
    hull = shapely.convex_hull(shapely.union_all([road.curve.line for road in model.roads]))
    for k, (exit_, entry) in enumerate(round_it):
        ring = hull.buffer(RING_GAP_M + k * RING_STEP_M, quad_segs=16)
        builder.lead_over(exit_, entry, ring)
    notes = {
        "turning_drops": len(two_way),
        "carriageways_joined": len(adjacent),
        "roads_round_the_region": len(round_it),
        "open_ends": len(ends) - len(two_way) - 2 * (len(adjacent) + len(round_it)),
    }
    return builder.result(), notes


def _loose_ends(model: LaneModel, region: shapely.Polygon) -> list[_End]:
    """Return the ends that were cut, and the map's ends with free space ahead."""
    streets = [road for road in model.roads if road.junction < 0]
    lines = [road.curve.line.buffer(ROOM_M, cap_style="flat") for road in streets]
    tree = shapely.STRtree(lines)
    border = shapely.boundary(region)
    ends = []
    for number, road in enumerate(streets):
        for name, link in (("start", road.predecessor), ("end", road.successor)):
            if link is not None:
                continue
            end = _end(road, name)
            if not (end.leaving or end.entering):
                continue
            ahead = np.array([math.cos(end.heading), math.sin(end.heading)])
            ray = shapely.LineString([end.point + ahead * 3.0, end.point + ahead * FAR_M])
            hits = set(tree.query(ray, predicate="intersects").tolist()) - {number}
            if not hits or shapely.distance(border, shapely.Point(end.point)) < CUT_M:
                ends.append(end)
    return ends


def _end(road: ModelRoad, end: str) -> _End:
    at_end = end == "end"
    section = road.sections[-1 if at_end else 0]
    x, y, heading = road.curve.at([road.length if at_end else 0.0])[0]
    lanes = sorted(
        (lane for lane in section.lanes if lane.kind in MOTOR), key=lambda lane: abs(lane.id)
    )
    lanes = [lane for lane in lanes if _wide(road, section, lane, at_end=at_end)]
    return _End(
        road,
        end,
        np.array([x, y]),
        float(heading) + (0.0 if at_end else math.pi),
        tuple(lane.id for lane in lanes if lane.forward == at_end),
        tuple(lane.id for lane in lanes if lane.forward != at_end),
    )


def _wide(road: ModelRoad, section: LaneSection, lane: SectionLane, *, at_end: bool) -> bool:
    """Return whether a lane is wide enough for traffic at a road's end."""
    s = road.length - section.s if at_end else 0.0
    return float(lane.width.at([s])[0]) > 2.0


def _close_pairs(exits: Sequence[_End], entries: Sequence[_End]) -> list[tuple[_End, _End]]:
    """Return pairs of carriageways of one street: close ends with similar headings."""
    pairs: list[tuple[_End, _End]] = []
    options = sorted(
        (float(np.linalg.norm(a.point - b.point)), i, j)
        for i, a in enumerate(exits)
        for j, b in enumerate(entries)
        if math.cos(a.heading - b.heading) > 0.5
    )
    used: set[tuple[str, int]] = set()
    for distance_m, i, j in options:
        if distance_m <= NEAR_M and not used & {("out", i), ("in", j)}:
            pairs.append((exits[i], entries[j]))
            used |= {("out", i), ("in", j)}
    return pairs


def _round(exits: Sequence[_End], entries: Sequence[_End]) -> list[tuple[_End, _End]]:
    """Return pairs of exits and entries, the nearest first, each used once."""
    options = sorted(
        (float(np.linalg.norm(a.point - b.point)), i, j)
        for i, a in enumerate(exits)
        for j, b in enumerate(entries)
    )
    pairs: list[tuple[_End, _End]] = []
    used: set[tuple[str, int]] = set()
    for _, i, j in options:
        if not used & {("out", i), ("in", j)}:
            pairs.append((exits[i], entries[j]))
            used |= {("out", i), ("in", j)}
    return pairs


class _Builder:
    """Addition of outer roads to a model."""

    def __init__(self, model: LaneModel) -> None:
        self.model = model
        self.side = -1 if model.driving_side == "right" else 1
        self.number = model.next_id
        self.roads: list[ModelRoad] = []
        self.junctions: list[ModelJunction] = []
        self.links: dict[tuple[int, str], RoadLink] = {}
        self.lanes: dict[tuple[int, str], dict[int, int]] = {}

    def turn_round(self, end: _End) -> None:
        """Add a turnaround from the outgoing to the incoming lanes of a two-way street."""
        junction, number = self._new(), self._new()
        loop_road = self._road(end, end, self._drop(end, end), number)
        cut = min(MOUTH_M, loop_road.length / 4)
        parts = {
            "out": part_of_road(loop_road, 0.0, cut, self._new()),
            "outer": part_of_road(loop_road, cut, loop_road.length - cut, number),
            "in": part_of_road(loop_road, loop_road.length - cut, loop_road.length, self._new()),
        }
        junction_link = RoadLink("junction", junction)
        lanes = [lane.id for lane in loop_road.sections[0].lanes]
        after = {lane: lane for lane in lanes}
        first = loop_road.sections[0].lanes
        connecting = [
            _joined(
                dataclasses.replace(parts["out"], junction=junction),
                (
                    RoadLink("road", end.road.id, end.end),
                    {lane.id: lane.predecessor for lane in first},
                ),
                (RoadLink("road", number, "start"), after),
            ),
            _joined(
                dataclasses.replace(parts["in"], junction=junction),
                (RoadLink("road", number, "end"), after),
                (
                    RoadLink("road", end.road.id, end.end),
                    {lane.id: lane.successor for lane in first},
                ),
            ),
        ]
        self.roads += [
            _joined(parts["outer"], (junction_link, {}), (junction_link, {})),
            *connecting,
        ]
        outgoing = tuple(
            (lane.predecessor, lane.id) for lane in first if lane.predecessor is not None
        )
        back = tuple((lane.id, lane.id) for lane in first if lane.successor is not None)
        self.junctions.append(
            ModelJunction(
                junction,
                "",
                (
                    Connection(end.road.id, connecting[0].id, "start", outgoing),
                    Connection(number, connecting[1].id, "start", back),
                ),
            )
        )
        self.links[end.road.id, end.end] = junction_link

    def lead_over(self, exit_: _End, entry: _End, ring: shapely.Polygon | None) -> None:
        """Add a road from the outgoing lanes of one street to the incoming lanes of another."""
        number = self._new()
        curve = self._drop(exit_, entry) if ring is None else self._round(exit_, entry, ring)
        road = self._road(exit_, entry, curve, number)
        self.roads.append(road)
        outer = road.sections[0].lanes
        self.lanes[exit_.road.id, exit_.end] = {
            lane.predecessor: lane.id for lane in outer if lane.predecessor is not None
        }
        self.lanes[entry.road.id, entry.end] = {
            lane.successor: lane.id for lane in outer if lane.successor is not None
        }
        self.links[exit_.road.id, exit_.end] = RoadLink("road", number, "start")
        self.links[entry.road.id, entry.end] = RoadLink("road", number, "end")

    def result(self) -> LaneModel:
        """Return the model with all added roads."""
        roads = [
            dataclasses.replace(
                road,
                predecessor=self.links.get((road.id, "start"), road.predecessor),
                successor=self.links.get((road.id, "end"), road.successor),
                sections=self._sections(road),
            )
            for road in self.model.roads
        ]
        return dataclasses.replace(
            self.model,
            roads=(*roads, *self.roads),
            junctions=(*self.model.junctions, *self.junctions),
        )

    def _sections(self, road: ModelRoad) -> tuple[LaneSection, ...]:
        """Return a street's sections with the lanes at its ends linked to outer roads."""
        sections = list(road.sections)
        for index, end in ((0, "start"), (-1, "end")):
            links = self.lanes.get((road.id, end), {})
            lanes = tuple(
                lane
                if lane.id not in links
                else dataclasses.replace(lane, predecessor=links[lane.id])
                if end == "start"
                else dataclasses.replace(lane, successor=links[lane.id])
                for lane in sections[index].lanes
            )
            sections[index] = dataclasses.replace(sections[index], lanes=lanes)
        return tuple(sections)

    def _new(self) -> int:
        self.number += 1
        return self.number - 1

    def _drop(self, exit_: _End, entry: _End) -> Curve:
        """Return the curve of a turnaround at the inner border of the innermost lane."""
        start, end = exit_.inner(exit_.leaving[0])[0], entry.inner(entry.entering[0])[0]
        gap = math.hypot(start[0] - end[0], start[1] - end[1])
        turn = "left" if self.side < 0 else "right"
        return dubins_path(start, end, radius=max(BUS_RADIUS_M, gap / 2), turn=turn)

    def _round(self, exit_: _End, entry: _End, ring: shapely.Polygon) -> Curve:
        start, end = exit_.inner(exit_.leaving[0])[0], entry.inner(entry.entering[0])[0]
        return _round_curve(start, end, ring)

    def _road(self, exit_: _End, entry: _End, curve: Curve, number: int) -> ModelRoad:
        """Return an outer road between two ends; its lanes lie outside its reference line."""
        _, z0, fall0 = exit_.inner(exit_.leaving[0])
        _, z1, fall1 = entry.inner(entry.entering[0])
        lanes = []
        users = _own_lane_classes(exit_)
        for k, lane_id in enumerate(exit_.leaving):
            into = entry.entering[k] if k < len(entry.entering) else None
            first = exit_.section.by_id[lane_id]
            widths = [
                exit_.width(lane_id),
                exit_.width(lane_id) if into is None else entry.width(into),
            ]
            lanes.append(
                SectionLane(
                    self.side * (k + 1),
                    first.kind,
                    Profile.ramp(widths[0], widths[1], curve.length),
                    True,
                    min(first.speed_limit or OUTER_MS, OUTER_MS),
                    tuple(dict.fromkeys((*allowed(first), *users))),
                    predecessor=lane_id,
                    successor=into,
                    mark="broken" if k + 1 < len(exit_.leaving) else "solid",
                )
            )
        ordered = tuple(sorted(lanes, key=lambda lane: -lane.id))
        return ModelRoad(
            id=number,
            name="",
            kind=exit_.road.kind,
            ways=OUTER,
            junction=-1,
            curve=curve,
            offset=Profile.constant(0.0),
            elevation=Profile.ramp(z0, z1, curve.length),
            bank=Profile.ramp(math.atan(fall0), math.atan(fall1), curve.length),
            crown=Profile.constant(0.0),
            sections=(LaneSection(0.0, ordered, "solid"),),
            predecessor=RoadLink("road", exit_.road.id, exit_.end),
            successor=RoadLink("road", entry.road.id, entry.end),
        )


def _own_lane_classes(end: _End) -> tuple[str, ...]:
    """Return the classes with outgoing lanes of their own: bicycles, buses."""
    onward = end.end == "end"
    return tuple(
        name
        for lane in end.section.lanes
        if lane.kind in ("bicycle", "bus") and lane.forward == onward
        for name in allowed(lane)
    )


def _joined(
    road: ModelRoad,
    before: tuple[RoadLink, Mapping[int, int | None]],
    after: tuple[RoadLink, Mapping[int, int | None]],
) -> ModelRoad:
    """Return a road of one section with other links of the road and its lanes."""
    lanes = tuple(
        dataclasses.replace(
            lane, predecessor=before[1].get(lane.id), successor=after[1].get(lane.id)
        )
        for lane in road.sections[0].lanes
    )
    section = dataclasses.replace(road.sections[0], lanes=lanes)
    return dataclasses.replace(road, predecessor=before[0], successor=after[0], sections=(section,))


def _round_curve(start: Pose2, end: Pose2, ring: shapely.Polygon) -> Curve:
    """Return the shorter path round the region from an outgoing lane to an incoming lane."""
    line = ring.exterior
    length = float(line.length)
    a, b = (float(line.project(shapely.Point(pose[:2]))) for pose in (start, end))
    sense = 1.0 if (b - a) % length <= length / 2 else -1.0
    distance_m = (sense * (b - a)) % length
    bend = 2.5 * RING_RADIUS_M
    if distance_m < 3 * bend:
        return dubins_path(start, end, radius=RING_RADIUS_M)
    stations = a + sense * np.linspace(bend, distance_m - bend, max(2, int(distance_m / STEP_M)))
    points = shapely.get_coordinates(line.interpolate(stations % length))
    ahead = shapely.get_coordinates(line.interpolate((stations + sense * 0.5) % length)) - points
    headings = np.arctan2(ahead[:, 1], ahead[:, 0])
    on, off = ((float(points[k, 0]), float(points[k, 1]), float(headings[k])) for k in (0, -1))
    middle = splined(points, on[2], off[2])
    parts = (
        dubins_path(start, on, radius=RING_RADIUS_M),
        middle,
        dubins_path(off, end, radius=RING_RADIUS_M),
    )
    return Curve(tuple(piece for part in parts for piece in part.pieces))
