"""Crosswalks of a map, assigned to the ends of the streets that they cross."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.roads.imported.edges import Edge, Nodes
from urbantwin.roads.imported.lane_links import allowed
from urbantwin.roads.model import LaneModel, RoadArea

__all__ = ["Crosswalk", "crosswalks_of_model"]

#: Range of a crosswalk before the end of its street and into the junction, metres.
BACK_M, BEYOND_M = 25.0, 20.0
#: Areas longer along a street than across it, and than this, do not cross it, metres.
BROAD_M = 6.0
#: Minimum cosine of the angle between streets that share a crosswalk.
PARALLEL = 0.7
#: Crosswalks farther from the end of a street are ignored for it, metres.
NEAR_M = 80.0
#: Minimum share of the carriageway's width that a crosswalk covers.
ACROSS = 0.5


@dataclass(frozen=True)
class Crosswalk:
    """A crosswalk over all lanes of a street, at one of its ends.

    Attributes:
        area: id of the area in the lane model.
        node: the node beside it.
        edges: ids of the edges that it crosses.
        line: (2, 2) its centre line from kerb to kerb, site frame.
        width: width of the crosswalk, metres.
        marking: its marking; empty if unknown.
    """

    area: int
    node: str
    edges: tuple[str, ...]
    line: NDArray[np.float64]
    width: float
    marking: str = ""


@dataclass(frozen=True)
class _Arm:
    """The end of a street: its edges, and its carriageway as seen from the junction."""

    node: str
    edges: tuple[str, ...]
    place: NDArray[np.float64]
    outwards: NDArray[np.float64]
    left: float
    right: float


def crosswalks_of_model(model: LaneModel, edges: tuple[Edge, ...], nodes: Nodes) -> list[Crosswalk]:
    """Return a crosswalk for each street that a mapped crosswalk crosses."""
    arms = _arms(edges, nodes)
    crosswalks: dict[tuple[str, tuple[str, ...]], Crosswalk] = {}
    for area in model.areas:
        if area.kind != "crosswalk" or area.road not in model.road_by_id:
            continue
        outline = area_in_plan(model, area)
        candidates = sorted(
            (
                (
                    abs(float((street_crosswalk.line.mean(axis=0) - arm.place) @ arm.outwards)),
                    k,
                    arm,
                    street_crosswalk,
                )
                for k, arm in enumerate(arms)
                if np.abs(outline[0] - arm.place).max() < NEAR_M
                if (street_crosswalk := _crosswalk_over(arm, area.id, outline))
            ),
            key=lambda item: item[:2],
        )
        for _, _, arm, street_crosswalk in candidates:
            # One crosswalk may cross both carriageways of a street: parallel arms.
            beside = arm.outwards @ candidates[0][2].outwards > PARALLEL
            if street_crosswalk.node == candidates[0][3].node and beside:
                painted = replace(street_crosswalk, marking=area.marking)
                crosswalks.setdefault((street_crosswalk.node, street_crosswalk.edges), painted)
    return list(crosswalks.values())


def area_in_plan(model: LaneModel, area: RoadArea) -> NDArray[np.float64]:
    """Return the outline of an area on a road (N, 2), site frame."""
    x, y, heading = model.road_by_id[area.road].curve.at(area.s)[0]
    ahead, left = area.corners[:, 0], area.corners[:, 1]
    c, s = np.cos(heading), np.sin(heading)
    return np.column_stack([x + c * ahead - s * left, y + s * ahead + c * left])


def _arms(edges: tuple[Edge, ...], nodes: Nodes) -> list[_Arm]:
    grouped: dict[tuple[str, int, str], list[Edge]] = {}
    for edge in edges:
        lanes = [edge.lane(index) for index in range(len(edge.lanes))]
        if all("pedestrian" in allowed(lane) for lane in lanes):
            continue  # Pedestrians need no crossing there, and netconvert makes none.
        first, last = edge.sections[0] == 0, edge.sections[-1] == len(edge.road.sections) - 1
        for at_road_end, end in ((first, "start"), (last, "end")):
            node = nodes.of_end[edge.road.id, end]
            if at_road_end and node in nodes.junctions:
                grouped.setdefault((node, edge.road.id, end), []).append(edge)
    return [_arm(node, end, group) for (node, _, end), group in sorted(grouped.items())]


def _arm(node: str, end: str, edges: list[Edge]) -> _Arm:
    road = edges[0].road
    s = 0.0 if end == "start" else road.length
    section = road.sections[0 if end == "start" else -1]
    borders = [
        float(road.border(section, edge.lane(k, 0 if end == "start" else -1), s, outer=outer)[0])
        for edge in edges
        for k in range(len(edge.lanes))
        if edge.lane(k).kind != "sidewalk"
        for outer in (False, True)
    ]
    x, y, heading = road.curve.at(s)[0]
    sign = 1.0 if end == "start" else -1.0
    outwards = sign * np.array([np.cos(heading), np.sin(heading)])
    left, right = max(borders) * sign, min(borders) * sign
    names = tuple(edge.id for edge in edges)
    return _Arm(node, names, np.array([x, y]), outwards, max(left, right), min(left, right))


def _crosswalk_over(arm: _Arm, area: int, outline: NDArray[np.float64]) -> Crosswalk | None:
    """Return the crosswalk over a street's end; ``None`` if it does not cross it."""
    normal = np.array([-arm.outwards[1], arm.outwards[0]])
    gap = outline - arm.place
    local = shapely.Polygon(np.column_stack([gap @ arm.outwards, gap @ normal])).buffer(0)
    lane = shapely.box(-BEYOND_M, arm.right, BACK_M, arm.left)
    common = shapely.intersection(local, lane)
    if common.is_empty or common.geom_type != "Polygon":
        return None
    low, right, high, left = common.bounds
    across = left - right
    if across < ACROSS * (arm.left - arm.right) or high - low > max(across, BROAD_M):
        return None
    # The centre of the outline at either kerb.
    ends = []
    for t in (arm.right, arm.left):
        inner = np.clip(t, right + 0.05, left - 0.05)
        cut = shapely.intersection(
            common, shapely.LineString([(low - 1, inner), (high + 1, inner)])
        )
        a, _, b, _ = cut.bounds
        ends.append(arm.place + arm.outwards * (a + b) / 2 + normal * t)
    return Crosswalk(area, arm.node, arm.edges, np.array(ends), max(common.area / across, 1.0))
