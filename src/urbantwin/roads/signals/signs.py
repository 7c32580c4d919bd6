"""Signs: speed limits at their changes, and mapped stop and give-way signs."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import SiteFrame
from urbantwin.roads.model import LaneModel, LaneSection, ModelRoad, RoadLink, RoadSignal
from urbantwin.roads.signals.approach import Frame
from urbantwin.roads.signals.country_practice import (
    mph,
    plate_of,
    speed_sign,
    stop_sign,
    yield_sign,
)
from urbantwin.roads.signals.pole_sites import CLEARANCE_M, FreeGround
from urbantwin.site.extract import Extract

__all__ = ["add_signs"]

#: Clear height below plates, metres (RiLSA and VwV-StVO to sections 39 to 43: 2.2 m; MUTCD 2A.18:
#: 2.1 m).
CLEAR_M = 2.2
#: Sizes of plates by shape: height and width, metres.
SIZES = {"disc": (0.6, 0.6), "upright": (0.75, 0.6), "octagon": (0.75, 0.75),
         "triangle": (0.9, 0.9)}  # fmt: skip
#: Distance of a limit sign beyond a junction or the region's border, and minimum length of streets
#: with one, metres.
BEYOND_M, SHORTEST_M = 8.0, 20.0
#: Maximum distance of a mapped stop sign from its junction, metres (as for signals).
BEFORE_M = 40.0
#: Lateral search distance for places of posts, metres.
SEARCH_M = 10.0
#: Limits that differ by less are equal, m/s.
SAME_M_S = 0.3
DRIVEN = ("driving", "bus")


@dataclass(frozen=True)
class _Course:
    """One direction of a street."""

    road: ModelRoad
    forward: bool

    @property
    def sections(self) -> tuple[tuple[float, LaneSection], ...]:
        """Station of the start of each section in the direction of travel, with the section."""
        if self.forward:
            return tuple((section.s, section) for section in self.road.sections)
        ends = self.road.section_ends
        return tuple(zip(ends, self.road.sections, strict=True))[::-1]

    def limit(self, section: LaneSection) -> float:
        """Return the speed limit of a section, m/s; 0 without traffic in this direction."""
        return max(
            (
                lane.speed_limit
                for lane in section.directed
                if lane.kind in DRIVEN and lane.forward == self.forward
            ),
            default=0.0,
        )

    def lanes(self, section: LaneSection) -> tuple[int, ...]:
        return tuple(
            lane.id
            for lane in section.directed
            if lane.kind in DRIVEN and lane.forward == self.forward
        )

    @property
    def entry(self) -> RoadLink | None:
        return self.road.predecessor if self.forward else self.road.successor

    @property
    def end(self) -> float:
        return self.road.length if self.forward else 0.0

    @property
    def goes_on(self) -> RoadLink | None:
        return self.road.successor if self.forward else self.road.predecessor


def add_signs(
    model: LaneModel, ground: FreeGround, extract: Extract, frame: SiteFrame, country: str
) -> tuple[LaneModel, dict[str, int]]:
    """Return the model with speed limit, stop and give-way signs, and counts of signs.

    Speed limits are signed where streets enter the region, where the limit changes along a street,
    and beyond a junction that traffic reaches at another limit.

    Args:
        model: the lane model.
        ground: free places for posts.
        extract: the map, for ``highway=stop`` and ``highway=give_way``.
        frame: the site frame.
        country: country of the signs (ISO 3166-1 alpha-2).
    """
    courses = {
        (road.id, forward): _Course(road, forward)
        for road in model.roads
        if road.junction < 0
        for forward in (True, False)
    }
    signs: list[RoadSignal] = []
    notes: Counter[str] = Counter()
    chosen = [*_limits(model, courses, country), *_rights(model, courses, extract, frame, country)]
    for course, s, sign in chosen:
        placed = _at_kerb(model, course, s, sign, ground)
        if placed is None:
            notes["signs without a place"] += 1
            continue
        signs.append(replace(placed, id=model.next_id + len(signs)))
        notes[sign.name.split()[0] + " signs"] += 1
    return replace(model, signals=(*model.signals, *signs)), dict(sorted(notes.items()))


def _limits(
    model: LaneModel, courses: dict[tuple[int, bool], _Course], country: str
) -> Iterator[tuple[_Course, float, RoadSignal]]:
    catalogue, sign = speed_sign(country)
    unit, metres_per_second = ("mph", 0.44704) if mph(country) else ("km/h", 1 / 3.6)
    for course in courses.values():
        # Roads without a way of the map lie beyond the region.
        if not any(course.road.ways) or course.road.length < SHORTEST_M:
            continue
        before: list[float] = _limits_before(model, courses, course)
        for s, section in course.sections:
            limit = course.limit(section)
            if not limit:
                break
            if not before or any(abs(other - limit) > SAME_M_S for other in before):
                value = float(round(limit / metres_per_second))
                sign_s = s + (BEYOND_M if course.forward else -BEYOND_M)
                text = f"limit {value:g} {unit}"
                yield course, sign_s, _sign(text, catalogue, sign.type, sign.subtype, value, unit)
            before = [limit]


def _limits_before(
    model: LaneModel, courses: dict[tuple[int, bool], _Course], course: _Course
) -> list[float]:
    """Return the limits of the streets that lead to the start of a course, m/s."""
    link = course.entry
    if link is None:
        return []
    if link.element == "road":
        other = courses.get((link.id, link.contact == "end"))
        feeding = [other] if other else []
    else:
        junction = model.junction_by_id.get(link.id)
        feeding = []
        for connection in junction.connections if junction else ():
            connecting = model.road_by_id.get(connection.connecting)
            ends = (connecting.predecessor, connecting.successor) if connecting else ()
            if not any(end and end.id == course.road.id for end in ends):
                continue
            for forward in (True, False):
                other = courses.get((connection.incoming, forward))
                goes_on = other.goes_on if other else None
                if other and goes_on and goes_on.id == link.id and other.road is not course.road:
                    feeding.append(other)
    limits = [other.limit(other.sections[-1][1]) for other in feeding if any(other.road.ways)]
    return [limit for limit in limits if limit]


def _rights(
    model: LaneModel,
    courses: dict[tuple[int, bool], _Course],
    extract: Extract,
    frame: SiteFrame,
    country: str,
) -> Iterator[tuple[_Course, float, RoadSignal]]:
    """Yield stop and give-way signs for streets with a mapped node before their end."""
    signalised = {
        (signal.road, signal.orientation == "+") for signal in model.signals if signal.dynamic
    }
    of_way: dict[int, list[_Course]] = {}
    for course in courses.values():
        at_junction = course.goes_on is not None and course.goes_on.element == "junction"
        if at_junction and (course.road.id, course.forward) not in signalised:
            for way_id in course.road.ways:
                of_way.setdefault(way_id, []).append(course)
    numbers = {"stop": stop_sign(country), "give_way": yield_sign(country)}
    signed: set[tuple[int, bool]] = set()
    for way_id, headings in _mapped(extract, of_way, frame):
        for node, kind, xy, heading, everybody in headings:
            del node
            candidates = sorted(
                (away, course.road.id, course.forward, course)
                for course in of_way[way_id]
                if (away := _before_end(course, xy, heading, everybody=everybody)) is not None
            )
            for _, number, forward, course in candidates if everybody else candidates[:1]:
                if (number, forward) not in signed and course.lanes(course.sections[-1][1]):
                    signed.add((number, forward))
                    catalogue, type_ = numbers[kind]
                    name = {"stop": "stop", "give_way": "yield"}[kind]
                    sign = _sign(name, catalogue, type_, "-1", math.nan, "")
                    back = -0.5 if course.forward else 0.5
                    yield course, course.end + back, sign


def _mapped(
    extract: Extract, ways: Iterable[int], frame: SiteFrame
) -> Iterator[tuple[int, list[tuple[int, str, NDArray[np.float64], float | None, bool]]]]:
    """Yield way -> its stop and give-way nodes: kind, place, heading, for all directions."""
    for identity in sorted(ways):
        osm_way = extract.ways.get(identity)
        if osm_way is None:
            continue
        nodes = [node for node in osm_way.nodes if node in extract.nodes]
        sign_nodes = []
        for k, node in enumerate(nodes):
            tags = extract.node_tags.get(node, {})
            kind = tags.get("highway", "")
            if kind not in ("stop", "give_way"):
                continue
            pair = [nodes[max(k - 1, 0)], nodes[min(k + 1, len(nodes) - 1)]]
            a, b = frame.site_from_lonlat([extract.nodes[n] for n in pair])
            along = math.atan2(b[1] - a[1], b[0] - a[0])
            direction_tag = tags.get("direction") or tags.get("traffic_sign:direction")
            heading = {"forward": along, "backward": along + math.pi}.get(direction_tag or "")
            xy = frame.site_from_lonlat([extract.nodes[node]])[0]
            sign_nodes.append((node, kind, xy, heading, tags.get("stop") == "all"))
        if sign_nodes:
            yield identity, sign_nodes


def _before_end(
    course: _Course, xy: NDArray[np.float64], heading: float | None, *, everybody: bool
) -> float | None:
    """Return a node's distance from a course's end, metres; ``None`` for other traffic's."""
    s, t = (float(v[0]) for v in course.road.curve.locate(xy[None]))
    away = course.end - s if course.forward else s - course.end
    beyond = -BEFORE_M / 2 if everybody else -8.0
    if not beyond <= away <= BEFORE_M or abs(t) > 12.0:
        return None
    if heading is not None:
        end_heading = course.road.curve.pose(s)[2] + (0.0 if course.forward else math.pi)
        if math.cos(end_heading - heading) < 0.0:
            return None
    return abs(away)


def _sign(
    name: str, catalogue: str, type_: str, subtype: str, value: float, unit: str
) -> RoadSignal:
    blank = RoadSignal(
        0, 0, name, False, catalogue, type_, subtype, value, unit, 0.0, 0.0, 0.0, "+"
    )
    tall, wide = SIZES[plate_of(blank)]
    return replace(blank, z=CLEAR_M + tall / 2, height=tall, width=wide)


def _at_kerb(
    model: LaneModel,
    course: _Course,
    s: float,
    sign: RoadSignal,
    ground: FreeGround,
) -> RoadSignal | None:
    """Return a sign placed at the kerb of its traffic's side; ``None`` if no place is free."""
    road = course.road
    s = float(np.clip(s, 0.0, road.length))
    section = road.section_at(min(s, road.length - 1e-6))
    lanes = course.lanes(section)
    if not lanes:
        return None
    sign_of_v = 1.0 if course.forward else -1.0
    outward = -1.0 if model.driving_side == "right" else 1.0
    borders = [
        sign_of_v * float(road.border(section, section.by_id[lane], s, outer=outer)[0])
        for lane in lanes
        for outer in (False, True)
    ]
    kerb = max(borders, key=lambda v: outward * v)
    x, y, heading = road.curve.pose(s)
    frame = Frame(x, y, heading + (0.0 if course.forward else math.pi))
    v = kerb + outward * np.arange(CLEARANCE_M, SEARCH_M, 0.2)
    free = ground.free(frame.place(0.0, v), road.level)
    if not free.any():
        return None
    return replace(
        sign,
        road=road.id,
        s=s,
        t=sign_of_v * float(v[np.argmax(free)]),
        orientation="+" if course.forward else "-",
        lanes=lanes,
    )
