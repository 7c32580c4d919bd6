"""Proposal of a junction in an extract: the busiest well-mapped one."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame, wrapped
from urbantwin.number_text import finite_number
from urbantwin.site.extract import Extract, Way
from urbantwin.site.extract_coverage import clusters, local_frame, mapped_area, small_features

__all__ = [
    "STREETS",
    "JunctionArm",
    "JunctionProposal",
    "MappedJunction",
    "mapped_junctions",
    "meeting_nodes",
    "propose_junction",
    "streets_near",
    "titled",
    "way_lanes",
]

#: Weight of a road class in how busy a junction is, and its typical lanes per direction. Motorways
#: count little: users twin junctions, not ramps.
STREETS: dict[str, tuple[float, int]] = {
    "motorway": (1.0, 3), "motorway_link": (1.0, 1), "trunk": (6.0, 2), "trunk_link": (2.0, 1),
    "primary": (6.0, 2), "primary_link": (2.0, 1), "secondary": (4.5, 1),
    "secondary_link": (2.0, 1), "tertiary": (3.0, 1), "tertiary_link": (1.5, 1),
    "unclassified": (1.5, 1),
    "residential": (1.5, 1), "living_street": (0.7, 1), "road": (1.0, 1),
}  # fmt: skip

#: Nodes where streets meet form one junction up to this distance, metres.
_LINK_M = 28.0
#: A signal belongs to a junction up to this distance from where its streets meet, metres.
_SIGNAL_M = 40.0
#: Distance from the centre (or beyond its nodes) at which arms are counted, metres.
_RING_M = 30.0
#: Streets that leave within this angle form one arm (two carriageways), degrees.
_ARM_DEG = 30.0
#: Most street names in a title.
MOST_NAMES = 4


@dataclass(frozen=True)
class JunctionProposal:
    """A proposed junction.

    Attributes:
        latitude: latitude of its centre, degrees, WGS84.
        longitude: longitude of its centre, degrees, WGS84.
        names: names of its streets, most important first; empty without names.
        signals: number of its mapped traffic signals; 0 if the extract has no signalised junction,
            and this is the busiest other one.
        arms: number of arms.
    """

    latitude: float
    longitude: float
    names: tuple[str, ...]
    signals: int
    arms: int

    @property
    def signalised(self) -> bool:
        """Whether traffic signals are mapped there."""
        return self.signals > 0


@dataclass(frozen=True)
class JunctionArm:
    """An arm of a junction.

    Attributes:
        angle_deg: direction, degrees counter-clockwise from east.
        weight: weight of its road class, see `STREETS`.
        lanes: number of lanes in both directions.
        name: name of its street; empty without one.
    """

    angle_deg: float
    weight: float
    lanes: float
    name: str


@dataclass(frozen=True)
class MappedJunction:
    """A junction as mapped.

    Attributes:
        middle: x, y of its centre in the requested frame, metres.
        node: its node nearest to the centre.
        nodes: all nodes where its streets meet.
        arms: its arms.
        signals: number of mapped vehicle signals.
        crossing_signals: number of mapped crossing signals.
    """

    middle: tuple[float, float]
    node: int
    nodes: tuple[int, ...]
    arms: tuple[JunctionArm, ...]
    signals: int
    crossing_signals: int


def way_lanes(way: Way) -> float:
    """Return a street's number of lanes in both directions, as mapped or typical."""
    one_way = way.tags.get("oneway") in ("yes", "1", "-1", "true")
    usual = STREETS.get(way.tags.get("highway", ""), (0.0, 1))[1] * (1 if one_way else 2)
    said = finite_number(way.tags.get("lanes"))
    # The typical number is limited to the same bounds.
    return min(max(float(usual) if said is None else said, 1.0), 12.0)


def meeting_nodes(extract: Extract, streets: Iterable[Way]) -> list[int]:
    """Return the nodes with streets in at least three directions, sorted."""
    neighbours: dict[int, set[int]] = defaultdict(set)
    for way in streets:
        for a, b in pairwise([node for node in way.nodes if node in extract.nodes]):
            neighbours[a].add(b)
            neighbours[b].add(a)
    return sorted(node for node, others in neighbours.items() if len(others) >= 3)


def propose_junction(extract: Extract, within: shapely.Polygon | None = None) -> JunctionProposal:
    """Return the busiest signalised junction of an extract with mapped surroundings.

    Close nodes where streets meet form one junction. A junction's arms are weighted by class and
    lanes. Junctions near the border of the data, or outside, count less, since cross streets and
    buildings are missing there.

    Args:
        extract: the extract.
        within: area of considered junctions; longitude and latitude, degrees.

    Raises:
        InputError: the extract has no streets, or none meet in ``within``.
    """
    if not extract.highways():
        raise InputError("holds no roads", file=extract.path, expected="ways with a highway tag")
    streets = [way for way in extract.highways() if way.tags["highway"] in STREETS]
    frame = local_frame(extract)
    streets = [way for way in streets if _is_near(extract, way, frame)]
    if not streets:
        raise InputError(
            "holds paths and service roads but no streets",
            file=extract.path,
            expected="ways with a highway tag from residential to motorway",
        )
    return _Junctions(extract, frame, streets).best(within)


def mapped_junctions(
    extract: Extract, frame: SiteFrame, within: shapely.Polygon
) -> list[MappedJunction]:
    """Return the junctions with their centre in an area, in a frame, sorted by x."""
    streets = [way for way in extract.highways() if way.tags["highway"] in STREETS]
    streets = [way for way in streets if _is_near(extract, way, frame)]
    found = _Junctions(extract, frame, streets).all() if streets else []
    inside = [one for one in found if within.contains(shapely.Point(one.middle))]
    return sorted(inside, key=lambda one: (one.middle, one.node))


def titled(names: Sequence[str]) -> str:
    """Return a junction's title: the names of its streets, the first few if it has many."""
    return " / ".join(names[:MOST_NAMES])


def streets_near(extract: Extract, frame: SiteFrame) -> tuple[str, ...]:
    """Return the names of the streets at a frame's origin, the most important first."""
    found: dict[str, tuple[float, float]] = {}
    for way in extract.highways():
        name, weight = way.tags.get("name"), STREETS.get(way.tags["highway"], (0.0, 1))[0]
        if not name or not weight or not _is_near(extract, way, frame):
            continue
        away = float(shapely.LineString(extract.way_line(way, frame)).distance(shapely.Point(0, 0)))
        if away <= _SIGNAL_M:
            found[name] = min(found.get(name, (0.0, away)), (-weight, away))
    return tuple(sorted(found, key=lambda name: (*found[name], name)))


def _is_near(extract: Extract, way: Way, frame: SiteFrame) -> bool:
    nodes = np.array([extract.nodes[node] for node in way.nodes if node in extract.nodes])
    middle = [frame.longitude, frame.latitude]
    return len(nodes) >= 2 and bool(np.abs(nodes - middle).max() < 1.0)


class _Junctions:
    """The junctions of an extract's streets, for comparison."""

    def __init__(self, extract: Extract, frame: SiteFrame, streets: list[Way]) -> None:
        self.extract, self.frame, self.streets = extract, frame, streets
        self.lines = [shapely.LineString(extract.way_line(way, frame)) for way in streets]
        self.tree = shapely.STRtree(self.lines)
        self.area = mapped_area(extract, frame)
        self.things = cKDTree(np.vstack([small_features(extract, frame), [[0.0, 0.0]]]))
        self.ways_at: dict[int, list[Way]] = defaultdict(list)
        for way in streets:
            for node in dict.fromkeys(node for node in way.nodes if node in extract.nodes):
                self.ways_at[node].append(way)
        self.cores = meeting_nodes(extract, streets)
        tags = extract.node_tags
        self.signals = self._places(
            [n for n in sorted(self.ways_at) if tags.get(n, {}).get("highway") == "traffic_signals"]
        )
        self.crossings = self._places(
            [
                n
                for n in sorted(self.ways_at)
                if tags.get(n, {}).get("crossing") == "traffic_signals"
            ]
        )

    def best(self, within: shapely.Polygon | None) -> JunctionProposal:
        if not self.cores and within is None:
            return self._longest_street()
        if within is not None:
            places = np.array([self.extract.nodes[node] for node in self.cores]).reshape(-1, 2)
            inside = shapely.contains_xy(within, places[:, 0], places[:, 1])
            self.cores = [node for node, keep in zip(self.cores, inside, strict=True) if keep]
            if not self.cores:
                raise InputError(
                    "has no junction in the region",
                    file=self.extract.path,
                    expected="streets that meet there, or a latitude and longitude",
                )
        points = self._places(self.cores)
        numbers = clusters(points, _LINK_M)
        candidates = [np.flatnonzero(numbers == n) for n in range(int(numbers.max()) + 1)]
        scored = [self._scored(members, points) for members in candidates]
        signalised = [item for item in scored if item[1].signals > 0]
        # Ties are broken by position, so that the file's order does not matter.
        return max(
            signalised or scored, key=lambda item: (item[0], item[1].latitude, item[1].longitude)
        )[1]

    def all(self) -> list[MappedJunction]:
        points = self._places(self.cores)
        if not len(points):
            return []
        numbers = clusters(points, _LINK_M)
        found = []
        for number in range(int(numbers.max()) + 1):
            members = np.flatnonzero(numbers == number)
            middle, arms = self._middle_and_arms(members, points)
            away = np.linalg.norm(points[members] - middle, axis=1)
            nodes = tuple(self.cores[member] for member in members)
            found.append(
                MappedJunction(
                    (float(middle[0]), float(middle[1])),
                    nodes[int(np.argmin(away))],
                    nodes,
                    tuple(arms),
                    self._count(self.signals, points[members]),
                    self._count(self.crossings, points[members]),
                )
            )
        return found

    def _middle_and_arms(
        self, members: NDArray[np.int64], points: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], list[JunctionArm]]:
        strength = np.array([self._strength(self.cores[member]) for member in members])
        main = strength >= 0.6 * strength.max()
        middle = points[members[main]].mean(axis=0)
        reach = float(np.linalg.norm(points[members] - middle, axis=1).max())
        return middle, self._arms(middle, min(reach, 40.0) + _RING_M)

    def _scored(
        self, members: NDArray[np.int64], points: NDArray[np.float64]
    ) -> tuple[float, JunctionProposal]:
        middle, arms = self._middle_and_arms(members, points)
        busy = sum(arm.weight * arm.lanes**0.5 for arm in arms)
        shape = {0: 0.05, 1: 0.1, 2: 0.3}.get(len(arms), 1.0)
        signals = self._count(self.signals, points[members])
        crossings = self._count(self.crossings, points[members])
        lights = 1.0 + 0.1 * min(signals, 8) if signals else 0.6
        score = busy * shape * lights * self._completeness(middle)
        longitude, latitude = self.frame.lonlat_from_site(middle)[0]
        return score, JunctionProposal(
            round(float(latitude), 7),
            round(float(longitude), 7),
            _street_names(arms),
            signals or crossings,
            len(arms),
        )

    def _strength(self, node: int) -> float:
        """Return the weight of the second street at a node."""
        best: dict[str, float] = {}
        for number, way in enumerate(self.ways_at[node]):
            name = way.tags.get("name") or f"#{number}"
            best[name] = max(best.get(name, 0.0), STREETS[way.tags["highway"]][0])
        return sorted(best.values())[-2] if len(best) > 1 else 0.5 * max(best.values())

    def _arms(self, middle: NDArray[np.float64], radius: float) -> list[JunctionArm]:
        """Return the arms that cross a circle; streets in nearly the same direction are merged."""
        ring = shapely.Point(middle).buffer(radius, quad_segs=16).exterior
        crossings = []
        for index in np.sort(self.tree.query(ring, predicate="intersects")):
            way = self.streets[index]
            for x, y in shapely.get_coordinates(shapely.intersection(self.lines[index], ring)):
                angle = float(np.degrees(np.arctan2(y - middle[1], x - middle[0])))
                weight = STREETS[way.tags["highway"]][0]
                crossings.append(
                    JunctionArm(angle, weight, way_lanes(way), way.tags.get("name", ""))
                )
        crossings.sort(key=lambda arm: (arm.angle_deg, arm.name))
        arms: list[list[JunctionArm]] = []
        for arm in crossings:
            if arms and arm.angle_deg - arms[-1][-1].angle_deg < _ARM_DEG:
                arms[-1].append(arm)
            else:
                arms.append([arm])
        if len(arms) > 1 and arms[0][0].angle_deg + 360.0 - arms[-1][-1].angle_deg < _ARM_DEG:
            arms[0] = arms.pop() + arms[0]
        merged = []
        for group in arms:
            main = max(group, key=lambda arm: (arm.weight, arm.lanes, arm.name))
            lanes = sum(arm.lanes for arm in group)
            merged.append(JunctionArm(main.angle_deg, main.weight, lanes, main.name))
        return merged

    def _completeness(self, middle: NDArray[np.float64]) -> float:
        """Return how completely the surroundings are mapped, 0..1."""
        point = shapely.Point(middle)
        if not self.area.contains(point):
            depth = 0.3 * float(np.exp(-shapely.distance(self.area, point) / 20.0))
        else:
            rim = float(shapely.distance(self.area.exterior, point))
            depth = 0.5 + 0.5 * min(1.0, rim / 150.0)
        things = len(self.things.query_ball_point(middle, 100.0))
        return depth * (0.4 + 0.6 * min(1.0, things / 25.0))

    def _longest_street(self) -> JunctionProposal:
        """Return the middle of the longest street, for an extract where no streets meet."""
        index = int(np.argmax([line.length for line in self.lines]))
        middle = shapely.get_coordinates(self.lines[index].interpolate(0.5, normalized=True))[0]
        longitude, latitude = self.frame.lonlat_from_site(middle)[0]
        name = self.streets[index].tags.get("name")
        signals = self._count(self.signals, middle[None])
        place = round(float(latitude), 7), round(float(longitude), 7)
        return JunctionProposal(*place, (name,) if name else (), signals, 2)

    def _places(self, nodes: list[int]) -> NDArray[np.float64]:
        return self.frame.site_from_lonlat([self.extract.nodes[node] for node in nodes])

    @staticmethod
    def _count(signals: NDArray[np.float64], points: NDArray[np.float64]) -> int:
        if not len(signals):
            return 0
        return int((cKDTree(points).query(signals)[0] <= _SIGNAL_M).sum())


def _street_names(arms: list[JunctionArm]) -> tuple[str, ...]:
    """Return street names: most important first, then crossing streets, then the rest."""
    ranked = sorted((arm for arm in arms if arm.name), key=lambda arm: (-arm.weight, arm.name))
    if not ranked:
        return ()
    straight_on = ranked[0].angle_deg + 180.0
    ranked[1:] = sorted(
        ranked[1:],
        key=lambda arm: abs(wrapped(arm.angle_deg - straight_on, 360.0)) < 40.0,
    )
    return tuple(dict.fromkeys(arm.name for arm in ranked))
