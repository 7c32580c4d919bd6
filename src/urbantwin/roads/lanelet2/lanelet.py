"""Lanelets: two bounds in the direction of travel, their kind, and their permitted users."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.roads.lanelet2.document import Document, Relation
from urbantwin.roads.lanelet2.projection import Places
from urbantwin.roads.lanelet2.traffic_rules import allowed_of, kind_of

__all__ = ["Lanelet", "bounds_of", "lanelet_of"]

#: Maximum length of a bound, metres: in a longer one a point is misplaced.
LONGEST_M = 10_000.0
#: Bounds with a smaller mean distance are one line, metres.
NO_WIDTH_M = 0.05


@dataclass(frozen=True)
class Lanelet:
    """A lanelet, with its bounds in its direction of travel.

    Attributes:
        id: id of its relation.
        tags: its tags.
        ways: ids of the ways of the left and of the right bound.
        turned: whether each way runs against the lanelet.
        nodes: ids of the nodes of the left and of the right bound.
        left: (N, 3) left bound, site frame.
        right: (M, 3) right bound.
        regulations: ids of its regulatory elements.
    """

    id: int
    tags: dict[str, str]
    ways: tuple[int, int]
    turned: tuple[bool, bool]
    nodes: tuple[tuple[int, ...], tuple[int, ...]]
    left: NDArray[np.float64]
    right: NDArray[np.float64]
    regulations: tuple[int, ...]

    @cached_property
    def kind(self) -> str:
        """Kind of lane, ``crosswalk``, or empty for other lanelets."""
        return kind_of(self.tags)

    @cached_property
    def allowed(self) -> tuple[str, ...]:
        """Classes of actors that may use it."""
        return allowed_of(self.tags)

    @property
    def drives(self) -> bool:
        """Whether it is for vehicles, including parking and shoulders."""
        return self.kind not in ("", "sidewalk", "crosswalk")

    @property
    def within(self) -> bool | None:
        """Whether it is mapped as part of an intersection; ``None`` if unknown.

        ``turn_direction`` is Autoware's tag; ``intersection`` is set for lanelets converted from
        maps with this property per lane.
        """
        if "turn_direction" in self.tags:
            return True
        tag = self.tags.get("intersection")
        return None if tag is None else tag == "yes"

    @property
    def start(self) -> tuple[int, int]:
        """First nodes of the left and of the right bound."""
        return self.nodes[0][0], self.nodes[1][0]

    @property
    def end(self) -> tuple[int, int]:
        """Last nodes of the left and of the right bound."""
        return self.nodes[0][-1], self.nodes[1][-1]

    @cached_property
    def centre(self) -> shapely.LineString:
        """Centre line between the bounds."""
        share = np.linspace(0.0, 1.0, 33)
        both = [
            shapely.get_coordinates(
                shapely.line_interpolate_point(shapely.LineString(bound), share, normalized=True),
                include_z=True,
            )
            for bound in (self.left, self.right)
        ]
        return shapely.LineString((both[0] + both[1]) / 2)

    @cached_property
    def polygon(self) -> shapely.Geometry:
        """Area between the bounds in plan."""
        ring = np.vstack([self.left[:, :2], self.right[::-1, :2]])
        return shapely.make_valid(shapely.Polygon(ring))


def bounds_of(document: Document, identity: int, relation: Relation) -> tuple[int, int]:
    """Return the ways of a lanelet's left and right bound.

    Raises:
        InputError: a bound is missing, repeated, or refers to missing elements.
    """
    bounds = []
    for role in ("left", "right"):
        way_ids = relation.of_role(role)
        if len(way_ids) != 1:
            many = "no" if not way_ids else str(len(way_ids))
            raise document.error(f"has {many} ways of role {role}, not one", identity)
        osm_way = document.ways.get(way_ids[0])
        if osm_way is None:
            raise document.error(f"refers to way {way_ids[0]}, which the file lacks", identity)
        missing = next((n for n in osm_way.nodes if n not in document.nodes), None)
        if missing is not None:
            raise document.error(
                f"way {way_ids[0]} refers to node {missing}, which the file lacks", identity
            )
        if len(set(osm_way.nodes)) < 2:
            raise document.error(f"way {way_ids[0]} has fewer than two points", identity)
        bounds.append(way_ids[0])
    if bounds[0] == bounds[1]:
        raise document.error(f"way {bounds[0]} is its left and its right bound", identity)
    return bounds[0], bounds[1]


def lanelet_of(document: Document, identity: int, ways: tuple[int, int], places: Places) -> Lanelet:
    """Return a lanelet with its bounds in its direction of travel.

    A way may be drawn in either direction: a bound is reversed if the other one's middle does not
    lie on its proper side.

    Raises:
        InputError: a point of a bound has no position, a bound has no length or is too long, or the
            lanelet has no width.
    """
    relation = document.relations[identity]
    for node in (node for way_id in ways for node in document.ways[way_id].nodes):
        if node not in places:
            raise document.error(f"node {node} has no finite latitude and longitude", identity)
    nodes = [_distinct(document.ways[way_id].nodes, places) for way_id in ways]
    lines = [np.array([places[n] for n in ids]) for ids in nodes]
    if any(len(line) < 2 for line in lines):
        raise document.error("has a bound without length", identity)
    longest = max(float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum()) for line in lines)
    if longest > LONGEST_M:
        raise document.error(f"has a bound of {longest / 1000:.0f} km", identity)
    turned = [False, False]
    for k, sign in ((0, -1.0), (1, 1.0)):
        if sign * _side(lines[k][:, :2], _middle(lines[1 - k][:, :2])) <= 0:
            turned[k] = True
            lines[k], nodes[k] = lines[k][::-1], nodes[k][::-1]
    lanelet = Lanelet(
        identity,
        relation.tags,
        ways,
        (turned[0], turned[1]),
        (nodes[0], nodes[1]),
        lines[0],
        lines[1],
        tuple(relation.of_role("regulatory_element", "relation")),
    )
    if lanelet.polygon.area < NO_WIDTH_M * longest:
        raise document.error("has no width", identity)
    return lanelet


def _distinct(nodes: tuple[int, ...], places: Places) -> tuple[int, ...]:
    """Remove nodes at the position of the previous one, but never an end."""
    distinct = [nodes[0]]
    for n in nodes[1:]:
        if np.linalg.norm(places[n][:2] - places[distinct[-1]][:2]) > 1e-4:
            distinct.append(n)
        elif n == nodes[-1]:
            distinct[-1] = n if len(distinct) > 1 else distinct[-1]
    return tuple(distinct)


def _middle(line: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(line[len(line) // 2] if len(line) > 2 else line.mean(axis=0))


def _side(line: NDArray[np.float64], point: NDArray[np.float64]) -> float:
    """Return the distance of a point to the left of a polyline; negative to the right, metres."""
    leg = np.diff(line, axis=0)
    gap = point - line[:-1]
    share = np.clip((gap * leg).sum(axis=1) / (leg**2).sum(axis=1), 0.0, 1.0)
    normal_gap = gap - share[:, None] * leg
    distance = np.linalg.norm(normal_gap, axis=1)
    k = int(np.argmin(distance))
    # At a corner two segments are equally near: use the one most perpendicular to the point.
    equal = np.flatnonzero(distance < distance[k] + 1e-9)
    cross = leg[equal, 0] * gap[equal, 1] - leg[equal, 1] * gap[equal, 0]
    best = cross[np.argmax(np.abs(cross) / np.linalg.norm(leg[equal], axis=1))]
    return float(np.copysign(distance[k], best))
