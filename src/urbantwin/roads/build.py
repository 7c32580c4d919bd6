"""The lane network of a region from OpenStreetMap."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import compress
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.progress import Progress, untold
from urbantwin.result_warning import ResultWarning
from urbantwin.roads.assignment.movement_flows import movement_flows
from urbantwin.roads.building_ground import building_grounds
from urbantwin.roads.bus_stops import bus_poles, bus_ways, with_buses
from urbantwin.roads.central_island import with_central_islands, with_painted_islands
from urbantwin.roads.cross_section import (
    MappedSegment,
    prepare_ways,
    reinterpreted,
    write_sumo_edges,
)
from urbantwin.roads.driving_side import country_of
from urbantwin.roads.grade_separation import (
    CLEARANCE_M,
    Crossing,
    Lift,
    LiftedRoad,
    LiftedTurn,
    find_crossings,
    levels_of_ways,
    lift_of_network,
    way_layer,
)
from urbantwin.roads.heights import RoadSurface, with_heights
from urbantwin.roads.heights.banked_widths import with_banked_widths
from urbantwin.roads.junctions import is_mini_roundabout, small_rings, with_junctions_of_map
from urbantwin.roads.lane_polylines import network_of_model
from urbantwin.roads.loop import OuterRoads, close_loop
from urbantwin.roads.merging_lanes import zip_merging_lanes
from urbantwin.roads.model import LaneModel
from urbantwin.roads.model.road import without_lines
from urbantwin.roads.netconvert import sumo_network
from urbantwin.roads.network import Lane, RoadNetwork
from urbantwin.roads.rails import add_rails, with_trams
from urbantwin.roads.region_pieces import region_pieces
from urbantwin.roads.round_standing import islands, warnings_of_ways
from urbantwin.roads.side_lanes import (
    CurbMove,
    add_side_lanes,
    before_buildings,
    corners_before_buildings,
    is_island,
    with_curbs,
    with_island_areas,
    with_moved_curbs,
)
from urbantwin.roads.signals.country_practice import practice_of
from urbantwin.roads.signals.default_programs import set_default_programs
from urbantwin.roads.signals.heads import place_heads
from urbantwin.roads.signals.pole_sites import FreeGround
from urbantwin.roads.signals.programs import set_programs
from urbantwin.roads.signals.signalised_junctions import mapped_signals
from urbantwin.roads.signals.signs import add_signs
from urbantwin.roads.streets import planar_model, with_furniture
from urbantwin.roads.sumo_geometry import redraw_sumo_network
from urbantwin.roads.sumo_network import edges_of_pieces, read_sumo_network
from urbantwin.site.access import CYCLE_TRACK, is_driven, opened
from urbantwin.site.extract import Extract, Way, WayPiece
from urbantwin.site.signals import SignalPlan

__all__ = ["NETWORK_CLASSES", "BuiltRoads", "build_roads"]

#: Values of ``highway`` that become lanes. Driveways, footways and tracks do not: they are numerous
#: and carry no through traffic.
NETWORK_CLASSES = frozenset(
    "motorway motorway_link trunk trunk_link primary primary_link secondary secondary_link "
    "tertiary tertiary_link unclassified residential living_street road busway".split()
) | {CYCLE_TRACK}
#: Margin around the region for buildings, which roads of the closed loop avoid, metres.
BESIDE_M = 150.0


#: Maximum distance between a crossing and its node of the map, metres.
FOUND_M = 3.0
#: Maximum number of consecutive lanes of a connection through a junction.
_MOST_INTERNAL_LANES = 4


@dataclass(frozen=True)
class BuiltRoads:
    """The roads of a site.

    Attributes:
        model: the lane model, the source of the others.
        network: its lanes as polylines.
        surface: heights of the road surface.
        notes: counts and omissions.
        warnings: warnings about the roads.
        curbs: index of a correction -> result for the drawn curb.
    """

    model: LaneModel
    network: RoadNetwork
    surface: RoadSurface
    notes: dict[str, object]
    warnings: tuple[ResultWarning, ...] = ()
    curbs: Mapping[int, CurbMove] = field(default_factory=dict)


def build_roads(  # noqa: PLR0913, PLR0915 - all that roads are made of
    extract: Extract,
    frame: SiteFrame,
    region: shapely.Polygon,
    elevation: Elevation,
    *,
    driving_side: str,
    out: Path,
    plans: Sequence[SignalPlan] = (),
    closed_loop: bool = False,
    per_hour: Mapping[str, float] | None = None,
    curbs: Mapping[int, Sequence[shapely.LineString]] | None = None,
    standing: Sequence[shapely.Geometry] = (),
    tell: Progress = untold,
) -> BuiltRoads:
    """Build the lane network of a region and write SUMO's network.

    Args:
        extract: the map.
        frame: the site frame.
        region: the region to build, site frame; roads end at its border.
        elevation: the ground.
        driving_side: ``right`` or ``left``.
        out: the ``.net.xml`` to write.
        plans: signal programs that replace assumed ones.
        closed_loop: whether outer roads beyond the region lead each exit back to an entry.
        per_hour: actors that enter the region per hour, by class; assumed programs serve them.
        curbs: index of a correction -> drawn lines of curbs, site frame.
        standing: outlines of static obstacles, site frame, that paths through junctions avoid.
        tell: called with the completed share (0..1) and the current task.

    Raises:
        InputError: the region has no roads, or a signal plan cannot be used.
        StageError: netconvert failed.
    """
    tell(0.0, "ways")
    features = extract.features(frame, region.buffer(BESIDE_M))
    houses = building_grounds(features, region)
    buildings = houses.everywhere
    standing = [*standing, *islands(features)]
    ways, tunnels = _network_ways(extract, frame, region)
    if not ways:
        raise InputError(
            "has no streets within the region",
            file=extract.path,
            place="highway",
            expected=f"ways of the classes {', '.join(sorted(NETWORK_CLASSES))}",
        )
    lines = {osm_way.id: extract.way_line(osm_way, frame) for osm_way in ways}
    crossings = [
        crossing
        for crossing in find_crossings(
            lines,
            {osm_way.id: frozenset(osm_way.nodes) for osm_way in ways},
            {osm_way.id: way_layer(osm_way.tags) for osm_way in ways},
        )
        if region.intersects(shapely.Point(crossing.point))
    ]
    level_of_way = levels_of_ways(crossings)
    signals = mapped_signals(extract, ways, frame)
    country = country_of(frame.latitude, frame.longitude)
    with tempfile.TemporaryDirectory(prefix="netconvert-", dir=out.parent) as scratch:
        osm = Path(scratch) / "network.osm"
        clipped = region_pieces(extract, frame, region, ways, tunnels)
        loop = OuterRoads(clipped.joined)
        if closed_loop:
            apart_nodes = {node for piece in clipped.before_portals for node in piece.nodes}
            loop = close_loop(
                clipped.joined,
                extract.nodes.keys() | apart_nodes,
                driving_side=driving_side,
                country=country,
                buildings=[*buildings, *clipped.ground_before_portals],
                standing=houses.within,
                region=region,
            )
        pieces = clipped.with_others(loop.pieces)
        prepared = prepare_ways(
            pieces,
            signals=_signalised(extract, pieces, signals.tags),
            driving_side=driving_side,
            country=country,
            buildings=buildings,
            stops=bus_poles(extract, frame),
        )
        pieces = prepared.pieces
        rings = small_rings(pieces, prepared.segments)
        standing = [*standing, *(ring.island for ring in rings)]
        extract.write_pieces(
            osm,
            frame,
            pieces,
            node_tags=signals.tags,
            no_turns=prepared.turns(loop.no_turns),
        )
        edges = Path(scratch) / "network.edg.xml"
        write_sumo_edges(edges, frame, prepared.edges)
        apart = [piece.id for piece in pieces if piece.way == 0 or piece.way in level_of_way]
        tell(0.15, "junctions")
        warnings = sumo_network(
            osm,
            frame,
            driving_side=driving_side,
            keep_apart=sorted(apart),
            edges=edges,
            reshape=partial(
                with_junctions_of_map,
                extract=extract,
                frame=frame,
                region=region,
                prepared=prepared,
                apart=apart,
                rings=rings,
                buildings=buildings,
                standing=standing,
                country=country,
                driving_side=driving_side,
            ),
            out=out,
        )
    tell(0.25, "signals")
    _set_merging_and_signals(out, pieces, bus_ways(extract), per_hour or {})
    planned = set_programs(out, plans, frame)
    raw = corners_before_buildings(
        read_sumo_network(
            out,
            driving_side=driving_side,
            level_of_way=level_of_way,
            origin={piece.id: piece.way for piece in pieces},
            arrows=prepared.arrows,
            one_lane=prepared.one_lane,
        ),
        buildings,
    )
    if not raw.roads:
        raise InputError(
            "has no streets that traffic could use within the region", file=extract.path
        )
    tell(0.3, "streets")
    lift = _lift(raw, crossings)
    raw = _with_junctions_on_bridges(raw, lift)
    planar = planar_model(raw, standing)
    tell(0.5, "side lanes")
    model = add_side_lanes(
        planar,
        prepared.segments,
        country=country,
        obstacles=buildings,
        crossings=_places(extract, frame, pieces, _is_crossed),
        islands=_places(extract, frame, pieces, is_island),
    )
    model, moved_curbs = with_moved_curbs(with_curbs(model), curbs or {})
    model = before_buildings(model, buildings)
    tell(0.6, "heights")
    model, surface = with_heights(model, elevation, lift)
    model = _with_lines_of_map(with_banked_widths(model), ways)
    tell(0.75, "lanes")
    model = with_island_areas(with_furniture(model, raw, surface.height))
    network = with_buses(network_of_model(model, raw, surface.height), extract, frame)
    model, network = with_central_islands(model, network, rings, surface.height)
    minis = _places(extract, frame, pieces, is_mini_roundabout)
    model = with_painted_islands(model, network, minis, surface.height)
    tell(0.87, "signs")
    ground = FreeGround(network)
    model = place_heads(model, network, ground, practice_of(country), surface.height)
    model, signs = add_signs(model, ground, extract, frame, country)
    redraw_sumo_network(out, network, buildings)
    network = with_trams(network, extract, frame, region, elevation, closed_loop=closed_loop)
    add_rails(out, network.tracks)
    notes: dict[str, object] = {
        "roads": len(network.roads),
        "junctions": len(network.junctions),
        "junctions_of_several_nodes": sum(
            junction.id.startswith("cluster_") for junction in network.junctions
        ),
        "signal_programs": len(network.programs),
        "signal_programs_set": planned,
        "signals_inferred_from_stop_lines_and_crossings": _count_in_region(
            extract, frame, region, signals.inferred
        ),
        "signalised_crossings_between_junctions": _count_in_region(
            extract, frame, region, signals.mid_block
        ),
        "signalised_crossings_left_out": _count_in_region(
            extract, frame, region, _unlit(extract, frame, signals.left_out, raw)
        ),
        "signal_heads": sum(signal.dynamic for signal in model.signals),
        "signs": signs,
        "bus_stops": len(network.stops),
        "tram_tracks": sum(not track.outer for track in network.tracks),
        "tram_stops": len(network.tram_stops),
        "closed_loop": loop.notes,
        "lifted_ways": len(level_of_way),
        "left_out_tunnels": len(tunnels),
        "roads_before_portals": len(clipped.before_portals),
        "left_out": [item.as_note() for item in clipped.left_out],
        "reinterpreted": _reinterpreted(ways, prepared.segments, frame),
        "netconvert_warnings": len(warnings),
    }
    unclear = warnings_of_ways(network, standing)
    return BuiltRoads(model, network, surface, notes, unclear, moved_curbs)


def _with_lines_of_map(model: LaneModel, ways: Sequence[Way]) -> LaneModel:
    """Return the model without lines on streets with ``lane_markings=no``."""
    bare = {osm_way.id for osm_way in ways if osm_way.tags.get("lane_markings") == "no"}
    return model.with_roads(
        tuple(
            without_lines(road) if road.ways and bare.issuperset(road.ways) else road
            for road in model.roads
        )
    )


def _reinterpreted(
    ways: Sequence[Way], segments: Sequence[MappedSegment], frame: SiteFrame
) -> list[str]:
    """Return messages on reinterpreted tags, each with its way and position."""
    first = {segment.way: segment for segment in reversed(segments)}
    messages = []
    for osm_way in ways:
        segment = first.get(osm_way.id)
        way_messages = [] if segment is None else reinterpreted(osm_way.tags, segment.section)
        if segment is not None and way_messages:
            longitude, latitude = frame.lonlat_from_site(segment.points[:1])[0]
            place = f"way {osm_way.id} at {latitude:.5f}, {longitude:.5f}"
            messages += [f"{place}: {words}" for words in way_messages]
    return messages


def _set_merging_and_signals(
    net: Path, pieces: Sequence[WayPiece], bus: Set[int], per_hour: Mapping[str, float]
) -> None:
    """Set zipper merging at merging lanes, and default signal programs for the expected flows."""
    zip_merging_lanes(net)
    outer = edges_of_pieces(net, {piece.id for piece in pieces if piece.way == 0})
    lines = edges_of_pieces(net, {piece.id for piece in pieces if piece.way in bus})
    set_default_programs(net, flows=movement_flows(net, outer, per_hour, bus_roads=lines))


def _unlit(
    extract: Extract, frame: SiteFrame, nodes: Sequence[int], network: RoadNetwork
) -> list[int]:
    """Return the nodes without a signalised crossing."""
    signalised = {head.lane for head in network.signals}
    lines = [
        shapely.LineString(lane.centre[:, :2])
        for lane in network.lanes
        if lane.kind == "crossing" and lane.id in signalised
    ]
    xy = frame.site_from_lonlat([extract.nodes[node] for node in nodes]).reshape(-1, 2)
    without_crossing = [
        not shapely.dwithin(lines, shapely.Point(position), FOUND_M).any() for position in xy
    ]
    return list(compress(nodes, without_crossing))


def _count_in_region(
    extract: Extract, frame: SiteFrame, region: shapely.Polygon, nodes: Sequence[int]
) -> int:
    """Return the number of nodes in the region."""
    xy = frame.site_from_lonlat([extract.nodes[node] for node in nodes]).reshape(-1, 2)
    return int(shapely.contains_xy(region, xy[:, 0], xy[:, 1]).sum())


def _network_ways(
    extract: Extract, frame: SiteFrame, region: shapely.Polygon
) -> tuple[list[Way], list[Way]]:
    """Return the ways of streets in a region, and those in tunnels.

    If most of the streets are not open to the public (a port, a test track), they count as open:
    the traffic is that of permitted users.
    """
    streets: list[Way] = []
    tunnels: list[Way] = []
    closed_m = 0.0
    for osm_way in extract.highways():
        if osm_way.tags["highway"] not in NETWORK_CLASSES or osm_way.tags.get("area") == "yes":
            continue
        line = extract.way_line(osm_way, frame)
        if len(line) < 2 or not region.intersects(shapely.LineString(line)):
            continue
        below = osm_way.tags.get("tunnel") not in (None, "no", "building_passage")
        (tunnels if below else streets).append(osm_way)
        if not below and is_driven(opened(osm_way.tags)):
            metres = shapely.length(shapely.intersection(region, shapely.LineString(line)))
            closed_m += -metres if is_driven(osm_way.tags) else metres
    if closed_m > 0:
        streets = [replace(osm_way, tags=opened(osm_way.tags)) for osm_way in streets]
    return streets, tunnels


def _is_crossed(tags: Mapping[str, str]) -> bool:
    return tags.get("highway") == "crossing" or is_island(tags)


def _places(
    extract: Extract,
    frame: SiteFrame,
    pieces: Sequence[WayPiece],
    only: Callable[[Mapping[str, str]], bool],
) -> NDArray[np.float64]:
    """Return the positions (N, 2) of street nodes with certain tags, site frame."""
    nodes = sorted({node for piece in pieces for node in piece.nodes})
    lonlat = [extract.nodes[node] for node in nodes if only(extract.node_tags.get(node, {}))]
    return frame.site_from_lonlat(np.array(lonlat).reshape(-1, 2))


def _signalised(
    extract: Extract, pieces: Sequence[WayPiece], told: Mapping[int, Mapping[str, str]]
) -> list[int]:
    """Return the nodes at which netconvert sets signals."""
    signal_nodes = []
    for node in sorted({node for piece in pieces for node in piece.nodes}):
        tags = told.get(node, extract.node_tags.get(node, {}))
        if "traffic_signals" in (tags.get("highway"), tags.get("crossing")):
            signal_nodes.append(node)
    return signal_nodes


def _lift(network: RoadNetwork, crossings: list[Crossing]) -> Lift:
    roads = []
    for road in network.roads:
        lanes = [network.lane_by_id[name] for name in road.lanes]
        ends = (road.from_junction, road.to_junction)
        inner, outer = lanes[-1], lanes[0]
        lines = [lane.centre[:, :2] for lane in reversed(lanes)]
        lines += [
            _points_beside(lane, side)
            for lane in {inner.id: inner, outer.id: outer}.values()
            for side in (-0.5, 0.5)
        ]
        roads.append(LiftedRoad(tuple(lines), inner.level, frozenset(road.ways), ends))
    number = {road.id: k for k, road in enumerate(network.roads)}
    turns = []
    for lane in network.lanes:
        for name in lane.successors if lane.road else ():
            centre_lines: list[NDArray[np.float64]] = []
            after = network.lane_by_id.get(name)
            while after is not None and not after.road and len(centre_lines) < _MOST_INTERNAL_LANES:
                centre_lines.append(after.centre[:, :2])
                after = network.lane_by_id.get(next(iter(after.successors), ""))
            if centre_lines and after is not None and after.road:
                centre = np.concatenate(centre_lines)
                turns.append(LiftedTurn(centre, number[lane.road], number[after.road]))
    return lift_of_network(roads, turns, crossings)


def _points_beside(lane: Lane, share: float) -> NDArray[np.float64]:
    """Return points (N, 2) beside a lane's centre line, by a share of its width to the left."""
    points = lane.centre[:, :2]
    ahead = np.gradient(points, axis=0)
    ahead /= np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-9)
    return np.asarray(points + share * lane.width * ahead[:, ::-1] * [-1.0, 1.0])


def _with_junctions_on_bridges(network: RoadNetwork, lift: Lift) -> RoadNetwork:
    """Return the network with junctions raised to the bridge that begins there.

    Where streets meet under the end of a bridge, a junction on the ground would link them to it.
    """
    level, low, overhead = dict[str, int](), set[str](), set[str]()
    for road in network.roads:
        lane = network.lane_by_id[road.lanes[-1]]
        ends = lift.at(lane.centre[[0, -1], :2], lane.level)
        for junction, height in zip((road.from_junction, road.to_junction), ends, strict=True):
            level[junction] = max(level.get(junction, 0), lane.level)
            if height < CLEARANCE_M / 2:
                low.add(junction)
        for junction, end in zip((road.from_junction, road.to_junction), (0, -1), strict=True):
            if lift.is_above_another(lane.centre[end, :2], lane.level):
                overhead.add(junction)
    raised = {name: up for name, up in level.items() if up and name in overhead - low}
    return replace(
        network,
        junctions=tuple(
            replace(item, level=raised.get(item.id, item.level)) for item in network.junctions
        ),
        lanes=tuple(
            replace(lane, level=raised.get(lane.junction, lane.level)) for lane in network.lanes
        ),
    )
