"""Layout of outer roads: new ways and nodes with new ids."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
import shapely

from urbantwin.geometry import stations_of_points
from urbantwin.roads.loop.free_space import ROAD_COST, FreeSpace, Points, unit
from urbantwin.roads.loop.road_ends import motor_lanes
from urbantwin.site import WayPiece
from urbantwin.site.access import either_way

__all__ = ["CLEARANCE_M", "Gate", "Layout", "half_width", "outer_tags", "turning_radius"]

Choice = TypeVar("Choice")
#: Smaller overlaps are ignored, square metres.
ROOM_M2 = 1.0
#: Cost of the area of a choice relative to its overlaps.
SIZE_COST = 0.1
#: Widths of roadside elements in plan, metres.
SIDEWALK_M, CYCLE_LANE_M = 2.5, 1.5
#: Clearance beside a road, metres.
CLEARANCE_M = 1.5
#: Radius of the inner border of turnarounds, metres: a 12 m bus has to pass between circles of 5.3
#: and 12.5 m (Directive 97/27/EC, annex I, 7.6.1), with its centre near 8 m.
INNER_M = 9.0
#: Tags of a street that its outer road inherits.
KEPT = ("highway", "motorroad", "surface")


@dataclass(frozen=True, eq=False)
class Gate:
    """The start or end of a one-way outer road.

    Attributes:
        node: id of the node.
        point: (2,) its position, site frame.
        heading: outwards, radians.
        street: number of the street that ends there; -1 on a turnaround.
        tags: the street's tags.
        lanes: number of lanes.
        lane_m: width of the lanes, metres.
        joints: nodes on the way out, nearest first, where roads of other gates join.
        beside: numbers of other streets that begin or end there.
    """

    node: int
    point: Points
    heading: float
    street: int
    tags: dict[str, str]
    lanes: int
    lane_m: float
    joints: list[tuple[int, Points]] = field(default_factory=list)
    beside: tuple[int, ...] = ()

    @property
    def ahead(self) -> Points:
        """The unit vector (2,) outwards."""
        return unit(self.heading)


class Layout:
    """The layout of outer roads.

    Args:
        pieces: the streets of the region.
        known: ids of nodes in use.
        side: driving side, ``right`` or ``left``.
        country: ISO 3166-1 alpha-2; empty if unknown.
        buildings: areas of buildings.
        standing: areas of buildings in the twin.
        region: area that roads round it avoid.
    """

    def __init__(
        self,
        pieces: Sequence[WayPiece],
        known: Iterable[int],
        side: str,
        country: str,
        buildings: Sequence[shapely.Geometry] = (),
        standing: Sequence[shapely.Geometry] = (),
        region: shapely.Geometry | None = None,
    ) -> None:
        self.pieces, self.side, self.country = list(pieces), side, country
        self.outer: list[WayPiece] = []
        self.no_turns: list[tuple[int, int, int]] = []
        self.nodes: list[int] = []
        self.overlaps = 0
        every = [node for piece in pieces for node in piece.nodes]
        self._next_node = max((*every, *known), default=0) + 1
        self._next_way = max((piece.id for piece in pieces), default=0) + 1
        self.lanes = [motor_lanes(piece.tags, side, country) for piece in pieces]
        widths = [
            half_width(sum(map(sum, lanes)), piece.tags)
            for piece, lanes in zip(pieces, self.lanes, strict=True)
        ]
        points = [piece.points for piece in pieces]
        self.space = FreeSpace(points, widths, buildings, standing, region)

    @property
    def turn(self) -> str:
        """The side to which traffic turns round."""
        return "left" if self.side == "right" else "right"

    def new_node(self) -> int:
        """Return an unused node id."""
        self._next_node += 1
        return self._next_node - 1

    def with_most_room(
        self,
        choices: Iterable[Choice],
        area_of: Callable[[Choice], shapely.Geometry],
        *own: int,
        twice: Callable[[Choice], float] = lambda choice: 0.0,
    ) -> Choice:
        """Return the first choice without overlap, else the one with the least cost.

        Args:
            choices: candidate layouts, the best first.
            area_of: function that returns the area of a choice.
            own: streets that it may touch.
            twice: function that returns its overlap with itself, square metres.
        """
        least = math.inf
        crowded = True
        for choice in choices:
            area = area_of(choice)
            size = SIZE_COST * area.area
            overlap = ROAD_COST * twice(choice)
            overlap += self.space.cost(area, *own, enough=max(ROOM_M2, least - size) - overlap)
            crowded = overlap > ROOM_M2
            if not crowded or overlap + size < least:
                best, least = choice, overlap + size
            if not crowded:
                break
        self.overlaps += crowded
        return best

    def lengthen(self, street: int, node: int, point: Points, *, at_start: bool) -> None:
        """Extend a street to a new node."""
        piece = self.pieces[street]
        nodes, points = piece.nodes, piece.points
        if at_start:
            nodes, points = (node, *nodes), np.vstack([point, points])
        else:
            nodes, points = (*nodes, node), np.vstack([points, point])
        self.pieces[street] = replace(piece, nodes=nodes, points=points)

    def add_halves(
        self,
        points: Points,
        tags: dict[str, str],
        *,
        first: int,
        last: int,
        joints: Mapping[int, int] | None = None,
        half: int | None = None,
    ) -> None:
        """Add an outer road as two ways that meet halfway; arguments as for ``add``.

        netconvert would cut off a single way where it comes near its own beginning. ``half`` is the
        index of the point where they meet; by default halfway along the road.
        """
        if half is None:
            along = stations_of_points(points)
            half = int(np.abs(along[1:-1] - along[-1] / 2).argmin()) + 1
        node_at = dict(joints or {})
        middle = node_at.get(half) or self.new_node()
        before = {k: node for k, node in node_at.items() if k < half}
        after = {k - half: node for k, node in node_at.items() if k > half}
        self.add(points[: half + 1], tags, first=first, last=middle, joints=before)
        self.add(points[half:], tags, first=middle, last=last, joints=after)

    def add(
        self,
        points: Points,
        tags: dict[str, str],
        *,
        first: int,
        last: int,
        joints: Mapping[int, int] | None = None,
    ) -> int:
        """Add an outer way and return its id.

        Args:
            points: (N, 2) its points.
            tags: its tags.
            first: node at its first point.
            last: node at its last point.
            joints: nodes at points between, by the index of the point.
        """
        node_of = {0: first, len(points) - 1: last, **(joints or {})}
        nodes = tuple(node_of[k] if k in node_of else self.new_node() for k in range(len(points)))
        self.nodes += node_of.values()
        way_id = self._next_way
        self._next_way += 1
        self.outer.append(WayPiece(way_id, 0, nodes, points, tags))
        return way_id


def turning_radius(carriageway_m: float) -> float:
    """Return the radius of the centre line of a turnaround, metres."""
    return INNER_M + carriageway_m / 2


def half_width(carriageway_m: float, tags: Mapping[str, str]) -> float:
    """Return half the width of a road including sidewalks and cycle lanes, metres."""
    width = carriageway_m / 2
    width += SIDEWALK_M if tags.get("sidewalk", "no") != "no" else 0.0
    return width + (CYCLE_LANE_M if _has_cycle_lane(tags) else 0.0)


def outer_tags(
    street: Mapping[str, str],
    lanes: int,
    lane_m: float,
    *,
    side: str,
    kmh: int,
    sidewalks: str,
) -> dict[str, str]:
    """Return the tags of a one-way outer road.

    Args:
        street: tags of the street that it continues, including ``sidewalk``.
        lanes: number of lanes.
        lane_m: width of the lanes, metres: that of the street, because SUMO's two-wheelers get
            stuck beside cars where lanes become narrower.
        side: driving side, ``right`` or ``left``.
        kmh: speed limit for its bends, km/h.
        sidewalks: sides with sidewalks if the street has any.
    """
    tags = {key: street[key] for key in KEPT if key in street} | either_way(street)
    tags |= {"oneway": "yes", "lanes": str(lanes), "maxspeed": str(kmh)}
    tags["width:lanes"] = "|".join([f"{lane_m:.2f}"] * lanes)
    tags["sidewalk"] = "no" if street.get("sidewalk", "no") == "no" else sidewalks
    if _has_cycle_lane(street):
        tags[f"cycleway:{side}"] = "lane"
    return tags


def _has_cycle_lane(tags: Mapping[str, str]) -> bool:
    return any(
        value in ("lane", "track", "opposite_lane", "opposite_track")
        for key, value in tags.items()
        if key.split(":")[0] == "cycleway"
    )
