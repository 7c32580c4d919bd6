"""What an OpenStreetMap file says of a place's streets, read by osmium alone: no code of ours.

Of the driven ways (those that vehicles use; tunnels left out, and ways closed to all of them), in a
plane about the anchor: crossings, signals, lanes and turn arrows.

- **Crossing**: a node `highway=crossing` of a driven way (not `crossing=no`), or
  `highway=traffic_signals` with `crossing=*`, and the place where a
  way `footway=crossing` (`path`, `cycleway`) crosses one on its own layer. Places on one way less
  than 4 m apart are one crossing; each carriageway of a dual one has its own.
- **Signal**: a node of a driven way with `highway=traffic_signals` or `crossing=traffic_signals`.
- **Lanes**: `lanes` of a driven way, seen every 10 m at least 15 m from where streets meet.
- **Arrows**: `turn:lanes` (`:forward`, `:backward`) of a way whose street does not go on with
  another way that has them.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import osmium
import shapely
from numpy.typing import NDArray
from pyproj import Transformer

DRIVEN = frozenset(
    "motorway motorway_link trunk trunk_link primary primary_link secondary secondary_link "
    "tertiary tertiary_link unclassified residential living_street road busway".split()
)
#: Access of buses where nobody else may drive.
OPEN = frozenset({"yes", "designated", "official", "permissive"})
#: Crossings of one way nearer to each other are one; lanes are counted this far from where
#: streets meet, so often; metres.
ONE_CROSSING_M, CLEAR_M, EVERY_M = 4.0, 15.0, 10.0
#: The street that leads to lanes is followed this far, metres, where it bends less than this.
APPROACH_M, STRAIGHT = 100.0, np.radians(40.0)


@dataclass(frozen=True)
class Crossing:
    """A mapped crossing: where, along which way's line it is crossed, and its tags."""

    x: float
    y: float
    street: shapely.LineString
    tags: dict[str, str]


@dataclass(frozen=True)
class Signal:
    """A mapped signal: where; headings of the traffic that it stops; what is mapped there."""

    x: float
    y: float
    headings: tuple[float, ...]
    is_junction: bool
    is_crossing: bool


@dataclass(frozen=True)
class Section:
    """A cross-section of a street: its middle, its heading, and lanes of both directions."""

    x: float
    y: float
    heading: float
    lanes: int


@dataclass(frozen=True)
class Arrows:
    """The turns of one direction's lanes, left to right, up to where they end.

    ``line`` is their way's, in their direction; ``before`` that of the street that leads there,
    to its end, and ``tagged_before`` whether lanes of it have turns, too.
    """

    line: NDArray[np.float64]
    lanes: tuple[frozenset[str], ...]
    is_one_way: bool
    before: NDArray[np.float64]
    tagged_before: bool


class MappedStreets:
    """The streets of an OpenStreetMap file near an anchor."""

    def __init__(self, path: Path, latitude: float, longitude: float) -> None:
        self._tags: dict[int, dict[str, str]] = {}
        self._at: dict[int, tuple[float, float]] = {}
        ways: list[tuple[int, list[int], dict[str, str]]] = []
        place = Transformer.from_crs(
            4326,
            f"+proj=tmerc +lat_0={latitude} +lon_0={longitude} +k=1 +ellps=WGS84 +units=m",
            always_xy=True,
        )
        for one in osmium.FileProcessor(str(path)):
            if one.is_node():
                self._at[one.id] = place.transform(one.location.lon, one.location.lat)
                if len(one.tags):
                    self._tags[one.id] = dict(one.tags)
            elif one.is_way() and "highway" in one.tags:
                ways.append((one.id, [node.ref for node in one.nodes], dict(one.tags)))
        self._lines = {
            way: np.array([self._at[node] for node in nodes if node in self._at]).reshape(-1, 2)
            for way, nodes, _ in ways
        }
        ways = [one for one in ways if len(self._lines[one[0]]) > 1]
        self.driven = [one for one in ways if _is_driven(one[2])]
        self._paths = [one for one in ways if not _is_driven(one[2])]
        self._owners: dict[int, list[tuple[int, int]]] = defaultdict(list)
        for number, (_, nodes, _) in enumerate(self.driven):
            for index, node in enumerate(nodes):
                self._owners[node].append((number, index))

    def _arms(self, node: int) -> int:
        """How many legs of driven ways meet at a node."""
        return sum(
            (index > 0) + (index < len(self.driven[way][1]) - 1)
            for way, index in self._owners[node]
        )

    def crossings(self) -> list[Crossing]:
        """Return the mapped crossings of driven ways."""
        found: dict[int, list[Crossing]] = defaultdict(list)
        for way, nodes, _ in self.driven:
            street = shapely.LineString(self._lines[way])
            for node in nodes:
                tags = self._tags.get(node, {})
                if _is_crossing(tags):
                    found[way].append(Crossing(*self._at[node], street, tags))
        streets = [shapely.LineString(self._lines[way]) for way, _, _ in self.driven]
        tree = shapely.STRtree(streets)
        for way, _, tags in self._paths:
            kinds = [tags.get(key) for key in ("footway", "path", "cycleway")]
            if "crossing" not in kinds or tags.get("crossing") == "no":
                continue
            path = shapely.LineString(self._lines[way])
            for number in sorted(tree.query(path, predicate="intersects")):
                owner, _, own = self.driven[number]
                if own.get("layer", "0") != tags.get("layer", "0"):
                    continue
                point = shapely.centroid(shapely.intersection(path, streets[number]))
                found[owner].append(Crossing(point.x, point.y, streets[number], tags))
        return [one for way in sorted(found) for one in _apart(found[way])]

    def signals(self) -> list[Signal]:
        """Return the mapped signals on driven ways."""
        found = []
        for node in sorted(self._owners):
            tags = self._tags.get(node, {})
            if "traffic_signals" not in (tags.get("highway"), tags.get("crossing")):
                continue
            told = tags.get("traffic_signals:direction", tags.get("direction", ""))
            headings = [
                heading
                for way, index in self._owners[node]
                for heading in self._headings_at(way, index, told)
            ]
            # Of a crossing that a one-way street begins at, no street that leads there is mapped.
            crossed = tags.get("highway") != "traffic_signals" or (
                not headings and _is_crossing(tags)
            )
            found.append(Signal(*self._at[node], tuple(headings), self._arms(node) > 2, crossed))
        return found

    def _headings_at(self, number: int, index: int, told: str) -> Iterator[float]:
        """Yield the headings of traffic that reaches a node along one of its ways."""
        _, nodes, tags = self.driven[number]
        line = np.array([self._at[node] for node in nodes if node in self._at])
        index = min(index, len(line) - 1)
        one_way = _one_way(tags)
        if index > 0 and one_way >= 0 and told != "backward":
            yield _heading(line[index - 1], line[index])
        if index < len(line) - 1 and one_way <= 0 and told != "forward":
            yield _heading(line[index + 1], line[index])

    def sections(self) -> Iterator[Section]:
        """Yield cross-sections of all ways that have ``lanes``."""
        meet = shapely.STRtree(
            [
                shapely.Point(self._at[n])
                for n in self._owners
                if n in self._at and self._arms(n) > 2
            ]
        )
        for way, _, tags in self.driven:
            if not tags.get("lanes", "").isdigit():
                continue
            line = shapely.LineString(self._lines[way])
            for at in np.arange(EVERY_M / 2, line.length, EVERY_M):
                here, ahead = (line.interpolate(s) for s in (at, min(at + 0.5, line.length)))
                if len(meet.query(here, predicate="dwithin", distance=CLEAR_M)):
                    continue
                heading = _heading((here.x, here.y), (ahead.x, ahead.y))
                yield Section(here.x, here.y, heading, int(tags["lanes"]))

    def arrows(self) -> Iterator[Arrows]:
        """Yield the turns of lanes where they end."""
        for way, nodes, tags in self.driven:
            one_way = _one_way(tags)
            line = self._lines[way]
            for key, sign in (
                ("turn:lanes", 0),
                ("turn:lanes:forward", 1),
                ("turn:lanes:backward", -1),
            ):
                if key not in tags or (sign == 0 and one_way == 0):
                    continue
                forward = (sign or one_way) > 0
                end = nodes[-1] if forward else nodes[0]
                if self._goes_on(way, end, forward):
                    continue
                lanes = tuple(
                    frozenset(part for part in one.split(";") if part not in ("", "none"))
                    for one in tags[key].split("|")
                )
                if any(lanes):
                    own = line if forward else line[::-1]
                    before, tagged = self._before(way, nodes if forward else nodes[::-1], own)
                    yield Arrows(own, lanes, one_way != 0, before, tagged)

    def _before(
        self, way: int, nodes: list[int], line: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], bool]:
        """The line of the street that leads straightest to a way, and whether it has turns."""
        parts, length, tagged, seen = [np.zeros((0, 2))], 0.0, False, {way}
        first, heading = nodes[0], _heading(line[0], line[1])
        while length < APPROACH_M:
            found = []
            for number, index in self._owners[first]:
                other, its, tags = self.driven[number]
                for forward, at_end in ((True, index == len(its) - 1), (False, index == 0)):
                    against = _one_way(tags) == (-1 if forward else 1)
                    if other in seen or not at_end or against:
                        continue
                    leg = self._lines[other] if forward else self._lines[other][::-1]
                    turn = abs(_wrapped(_heading(leg[-2], leg[-1]) - heading))
                    found.append((turn, other, leg, its[0] if forward else its[-1], tags, forward))
            if not found or min(one[0] for one in found) > STRAIGHT:
                break
            _, other, leg, first, tags, forward = min(found, key=lambda one: one[:2])
            seen.add(other)
            keys = ("turn:lanes", f"turn:lanes:{'forward' if forward else 'backward'}")
            tagged |= any(key in tags for key in keys)
            parts.insert(0, leg)
            heading = _heading(leg[0], leg[1])
            length += shapely.LineString(leg).length
        return np.concatenate(parts), tagged

    def _goes_on(self, way: int, end: int, forward: bool) -> bool:
        """Whether a street goes on beyond a node as one other way that has turns of lanes, too."""
        if self._arms(end) != 2:
            return False
        for number, index in self._owners[end]:
            other, _, tags = self.driven[number]
            if other != way:
                same = (index == 0) == forward
                keys = ("turn:lanes", f"turn:lanes:{'forward' if index == 0 else 'backward'}")
                return any(key in tags for key in keys) and (same or _one_way(tags) == 0)
        return False


def _is_crossing(tags: dict[str, str]) -> bool:
    kind, crossing = tags.get("highway"), tags.get("crossing")
    return crossing != "no" and (
        kind == "crossing" or (kind == "traffic_signals" and crossing is not None)
    )


def _is_driven(tags: dict[str, str]) -> bool:
    below = tags.get("tunnel", "no") not in ("no", "building_passage")
    keys = ("motor_vehicle", "vehicle", "access")
    access = next((tags[key] for key in keys if key in tags), "yes")
    closed = access in ("no", "private") and {tags.get("bus"), tags.get("psv")}.isdisjoint(OPEN)
    return tags["highway"] in DRIVEN and not (below or closed) and tags.get("area") != "yes"


def _one_way(tags: dict[str, str]) -> int:
    """Return 1 and -1 for streets of one direction, 0 for those of two."""
    if tags.get("oneway") in ("-1", "reverse"):
        return -1
    told = tags.get("oneway") in ("yes", "true", "1")
    implied = tags.get("junction") in ("roundabout", "circular") or tags["highway"] in (
        "motorway",
        "motorway_link",
    )
    return int(told or (implied and tags.get("oneway") != "no"))


def _apart(crossings: list[Crossing]) -> list[Crossing]:
    kept: list[Crossing] = []
    for one in crossings:
        if all(np.hypot(one.x - x.x, one.y - x.y) >= ONE_CROSSING_M for x in kept):
            kept.append(one)
    return kept


def _wrapped(angle: float) -> float:
    return float((angle + np.pi) % (2 * np.pi) - np.pi)


def _heading(start: tuple[float, float], end: tuple[float, float]) -> float:
    return float(np.arctan2(end[1] - start[1], end[0] - start[0]))
