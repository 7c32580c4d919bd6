"""The lane model in plan, from netconvert's network: streets and connecting roads."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import area_union
from urbantwin.roads.model import (
    CURB_HEIGHT_M,
    Connection,
    LaneModel,
    LaneSection,
    ModelJunction,
    ModelRoad,
    Profile,
    RoadLink,
    SectionLane,
)
from urbantwin.roads.model.road import with_lane_marks
from urbantwin.roads.network import RoadNetwork
from urbantwin.roads.streets.manoeuvre import Manoeuvre, build_manoeuvres, find_topology
from urbantwin.roads.streets.street import Street, Strip, build_streets

__all__ = ["planar_model"]

ZERO = Profile.constant(0.0)
#: Smaller distances between a street's trimmed end and its lanes' ends are ignored, metres.
CUT_M = 0.05
#: Half-widths of gaps that are closed, in this order, until a junction is one area, metres.
GAPS_M = (0.1, 0.5, 2.0, 5.0)


def planar_model(network: RoadNetwork, standing: Sequence[shapely.Geometry] = ()) -> LaneModel:
    """Return a network as a lane model with zero heights and without objects.

    On the right side of the road, lanes of negative ids run along the reference line; on the left
    side, lanes of positive ids do. A connecting road has one lane, whose centre line is the
    reference line.

    Args:
        network: the network from ``read_sumo_network``.
        standing: outlines of posts and islands that paths through junctions avoid, site frame.
    """
    side = 1 if network.driving_side == "left" else -1
    topology = find_topology(network)
    streets = build_streets(network, list(topology.edges), topology.trims, side=side)
    manoeuvres = build_manoeuvres(network, streets, topology, side=side, standing=standing)
    level = {junction.id: junction.level for junction in network.junctions}
    used = {m.junction for m in manoeuvres}
    names = [junction.id for junction in network.junctions if junction.id in used]
    first = 1 + len(streets) + len(manoeuvres)
    number = {name: first + k for k, name in enumerate(names)}
    ends = _ends(manoeuvres, number)
    members: dict[str, list[str]] = defaultdict(list)
    for name, stands_for in topology.junction.items():
        members[stands_for].append(name)
    outlines = _outlines(network, streets, members)
    roads = [_street(street, ends) for street in streets]
    roads += [_connecting(m, number[m.junction], level[m.junction]) for m in manoeuvres]
    junctions = []
    for name in names:
        through = [m for m in manoeuvres if m.junction == name]
        connections = tuple(
            Connection(m.entry.number, m.number, "start", ((m.start.id, m.side),)) for m in through
        )
        united = tuple(sorted(members[name]))
        junctions.append(
            ModelJunction(number[name], name, connections, outlines[name], level[name], united)
        )
    return LaneModel(network.driving_side, tuple(roads), tuple(junctions))


def _ends(manoeuvres: Sequence[Manoeuvre], number: Mapping[str, int]) -> dict[tuple[int, str], int]:
    """Return (road, ``start`` or ``end``) -> id of the junction there."""
    junction_at = {}
    for m in manoeuvres:
        junction_at[m.entry.number, "end" if m.start.forward else "start"] = number[m.junction]
        junction_at[m.exit.number, "start" if m.end.forward else "end"] = number[m.junction]
    return junction_at


def _street(street: Street, ends: Mapping[tuple[int, str], int]) -> ModelRoad:
    # A lane that both directions share is one lane, in the direction of the reference line.
    strips = [
        strip
        for strip in street.strips
        if strip.forward or strip.lane.opposite not in street.strip_of
    ]
    lanes = [replace(_lane(strip), opposite=strip.lane.opposite) for strip in strips]
    lanes = [
        lane if lane.opposite in street.strip_of else replace(lane, opposite="") for lane in lanes
    ]
    section = with_lane_marks(LaneSection(0.0, tuple(lanes)))
    before, after = (ends.get((street.number, end)) for end in ("start", "end"))
    return ModelRoad(
        id=street.number,
        name=street.edge.name,
        kind=street.edge.kind,
        ways=street.ways,
        junction=-1,
        curve=street.curve,
        offset=ZERO,
        elevation=ZERO,
        bank=ZERO,
        crown=ZERO,
        sections=(section,),
        predecessor=None if before is None else RoadLink("junction", before),
        successor=None if after is None else RoadLink("junction", after),
        level=street.strips[0].lane.level,
    )


def _lane(strip: Strip) -> SectionLane:
    lane = strip.lane
    return SectionLane(
        id=strip.id,
        kind=lane.kind,
        width=Profile.constant(lane.width),
        forward=strip.forward,
        speed_limit=lane.speed_limit,
        allowed=lane.allowed,
        strip=lane.id,
        height=CURB_HEIGHT_M if lane.kind == "sidewalk" else 0.0,
    )


def _connecting(manoeuvre: Manoeuvre, junction: int, level: int) -> ModelRoad:
    m = manoeuvre
    width = Profile.ramp(m.start.lane.width, m.end.lane.width, m.curve.length)
    lane = SectionLane(
        id=m.side,
        kind=m.kind,
        width=width,
        forward=True,
        speed_limit=m.speed_limit,
        allowed=m.allowed,
        strip=" ".join(m.route.via),
        predecessor=m.start.id,
        successor=m.end.id,
    )
    return ModelRoad(
        id=m.number,
        name="",
        kind=m.entry.edge.kind,
        ways=(),
        junction=junction,
        curve=m.curve,
        offset=Profile(width.start, -m.side * width.abcd / 2),
        elevation=ZERO,
        bank=ZERO,
        crown=ZERO,
        sections=(LaneSection(0.0, (lane,)),),
        predecessor=_link(m.entry, m.start, leaving=True),
        successor=_link(m.exit, m.end, leaving=False),
        level=level,
    )


def _link(street: Street, strip: Strip, *, leaving: bool) -> RoadLink:
    return RoadLink("road", street.number, "end" if strip.forward == leaving else "start")


def _outlines(
    network: RoadNetwork, streets: Sequence[Street], members: Mapping[str, Sequence[str]]
) -> dict[str, NDArray[np.float64]]:
    """Return the outline of each junction, including the parts cut off its streets."""
    shape = {junction.id: junction.polygon for junction in network.junctions}
    plain = {junction.id: junction.outline for junction in network.junctions}
    slabs: dict[str, list[shapely.Geometry]] = defaultdict(list)
    for street in streets:
        pose = street.curve.at([0.0, street.curve.length])
        left = np.column_stack([-np.sin(pose[:, 2]), np.cos(pose[:, 2])])
        driven = [strip for strip in street.strips if strip.lane.kind != "sidewalk"]
        for end, name in enumerate((street.start, street.end)):
            places = np.array([pose[end, :2] + strip.t * left[end] for strip in driven])
            mapped = np.array(
                [strip.lane.centre[0 if strip.forward == (end == 0) else -1] for strip in driven]
            )
            if not driven or np.abs(mapped[:, :2] - places).max() < CUT_M:
                continue
            half = np.array([[strip.lane.width / 2] for strip in driven]) * left[end]
            corners = np.vstack([x + h for x in (places, mapped[:, :2]) for h in (half, -half)])
            slabs[name].append(shapely.MultiPoint(corners).convex_hull)
    outlines = {}
    for name, parts in members.items():
        if len(parts) == 1 and parts[0] not in slabs:
            outlines[name] = plain[parts[0]]
            continue
        area = area_union([*(shape[p] for p in parts), *(s for p in parts for s in slabs[p])])
        for gap in GAPS_M:
            if len(shapely.get_parts(area)) == 1:
                break
            # Nodes of one junction may be apart, with short roads between them.
            closed = area.buffer(gap, join_style="mitre").buffer(-gap, join_style="mitre")
            area = area_union([area, closed])
        areas = shapely.get_parts(area)
        if len(areas) > 1:
            areas = [shapely.convex_hull(area)]
        outlines[name] = shapely.get_coordinates(areas[0].exterior)[:-1]
    return outlines
