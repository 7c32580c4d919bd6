"""From the map to the lane network."""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.roads.heights import with_heights
from urbantwin.roads.levels import (
    Crossing,
    Lift,
    find_crossings,
    levels_of_ways,
    lift_of_network,
    way_layer,
)
from urbantwin.roads.model import LaneModel
from urbantwin.roads.netconvert import sumo_network
from urbantwin.roads.network import RoadNetwork
from urbantwin.roads.reading import read_sumo_network
from urbantwin.roads.redraw import redraw_sumo_network
from urbantwin.roads.sidewalk import sidewalk_sides
from urbantwin.roads.signals.mapped import mapped_signals
from urbantwin.roads.signals.programs import set_programs
from urbantwin.roads.streets.furniture import furnished
from urbantwin.roads.streets.planar import planar_model
from urbantwin.roads.strips import network_of_model
from urbantwin.site.extract import Extract, Way
from urbantwin.site.signals import SignalPlan

__all__ = ["NETWORK_CLASSES", "BuiltRoads", "build_roads"]

#: Values of ``highway`` that become lanes. Driveways, footways and tracks do not: a district would
#: have thousands of them, and they carry no through traffic.
NETWORK_CLASSES = frozenset(
    "motorway motorway_link trunk trunk_link primary primary_link secondary secondary_link "
    "tertiary tertiary_link unclassified residential living_street road busway".split()
)


#: Tags that send people to a path beside the road.
SIDEPATHS = {("foot", "use_sidepath"), ("bicycle", "use_sidepath")}


@dataclass(frozen=True)
class BuiltRoads:
    """The roads of a site.

    Attributes:
        model: the lane model, the source of all else.
        network: its lanes as strips.
        lift: how far its roads are lifted off the ground.
        notes: counts, and what was left out.
    """

    model: LaneModel
    network: RoadNetwork
    lift: Lift
    notes: dict[str, object]


def build_roads(
    extract: Extract,
    frame: SiteFrame,
    region: shapely.Polygon,
    elevation: Elevation,
    *,
    driving_side: str,
    out: Path,
    plans: Sequence[SignalPlan] = (),
) -> BuiltRoads:
    """Build the lane network of a region and write SUMO's network beside it.

    Args:
        extract: the map.
        frame: the site frame.
        region: where to build, site frame; roads end at its border.
        elevation: the ground.
        driving_side: ``right`` or ``left``.
        out: the ``.net.xml`` to write.
        plans: programs of signals to use instead of netconvert's.

    Raises:
        InputError: the region holds no roads, or a plan for signals cannot be used.
        StageError: netconvert failed.
    """
    ways, tunnels = _network_ways(extract, frame, region)
    if not ways:
        raise InputError(
            "has no streets within the region",
            file=extract.path,
            place="highway",
            expected=f"ways of the classes {', '.join(sorted(NETWORK_CLASSES))}",
        )
    lines = {way.id: extract.way_line(way, frame) for way in ways}
    crossings = [
        crossing
        for crossing in find_crossings(
            lines,
            {way.id: frozenset(way.nodes) for way in ways},
            {way.id: way_layer(way.tags) for way in ways},
        )
        if region.intersects(shapely.Point(crossing.point))
    ]
    level_of_way = levels_of_ways(crossings)
    signals = mapped_signals(extract, ways, frame)
    with tempfile.TemporaryDirectory() as scratch:
        osm = Path(scratch) / "network.osm"
        pieces = extract.clipped(frame, region, _with_sidepaths(ways, lines, driving_side))
        extract.write_pieces(osm, frame, pieces, node_tags=signals.tags)
        apart = sorted(piece.id for piece in pieces if piece.way in level_of_way)
        warnings = sumo_network(osm, frame, driving_side=driving_side, keep_apart=apart, out=out)
    planned = set_programs(out, plans, frame)
    raw = read_sumo_network(
        out,
        driving_side=driving_side,
        level_of_way=level_of_way,
        origin={piece.id: piece.way for piece in pieces},
    )
    if not raw.roads:
        raise InputError(
            "has no streets that traffic could use within the region", file=extract.path
        )
    lift = _lift(raw, crossings)

    def height(xy: NDArray[np.float64], level: int) -> NDArray[np.float64]:
        return np.asarray(elevation.smooth_at(xy) + lift.at(xy, level))

    model = with_heights(planar_model(raw), elevation, lift)
    model = furnished(model, raw, height)
    network = network_of_model(model, raw, height)
    redraw_sumo_network(out, network)
    notes: dict[str, object] = {
        "roads": len(network.roads),
        "junctions": len(network.junctions),
        "signal_programs": len(network.programs),
        "signal_programs_set": planned,
        "signals_inferred_from_stop_lines_and_crossings": _within(
            extract, frame, region, signals.inferred
        ),
        "mid_block_signals_left_out": _within(extract, frame, region, signals.mid_block),
        "lifted_ways": len(level_of_way),
        "left_out_tunnels": len(tunnels),
        "netconvert_warnings": len(warnings),
    }
    return BuiltRoads(model, network, lift, notes)


def _within(
    extract: Extract, frame: SiteFrame, region: shapely.Polygon, nodes: Sequence[int]
) -> int:
    """Return how many nodes lie in the region."""
    xy = frame.site_from_lonlat([extract.nodes[node] for node in nodes]).reshape(-1, 2)
    return int(shapely.contains_xy(region, xy[:, 0], xy[:, 1]).sum())


def _network_ways(
    extract: Extract, frame: SiteFrame, region: shapely.Polygon
) -> tuple[list[Way], list[Way]]:
    kept: list[Way] = []
    tunnels: list[Way] = []
    for way in extract.highways():
        if way.tags["highway"] not in NETWORK_CLASSES or way.tags.get("area") == "yes":
            continue
        line = extract.way_line(way, frame)
        if len(line) < 2 or not region.intersects(shapely.LineString(line)):
            continue
        below = way.tags.get("tunnel") not in (None, "no", "building_passage")
        (tunnels if below else kept).append(way)
    return kept, tunnels


def _with_sidepaths(
    ways: list[Way], lines: dict[int, NDArray[np.float64]], driving_side: str
) -> list[Way]:
    one_way = ("yes", "1", "true")
    others = [(way.tags, lines[way.id]) for way in ways if way.tags.get("oneway") in one_way]
    result = []
    for way in ways:
        sides = sidewalk_sides(way.tags, lines[way.id], others, side=driving_side)
        # Sides stand in one tag of ours; paths beside the road do not close the road.
        tags = {
            key: value
            for key, value in way.tags.items()
            if not key.startswith("sidewalk") and (key, value) not in SIDEPATHS
        }
        if way.tags.get("bicycle") == "use_sidepath" and not any(
            key.startswith("cycleway") for key in tags
        ):
            # The cycleway is mapped as a way of its own: it becomes a lane of this road.
            tags["cycleway"] = "track"
        latin = tags.get("name:en", tags.get("int_name"))
        if latin and not _is_alphabetic(tags.get("name", "")):
            tags["name"] = latin
        result.append(dataclasses.replace(way, tags={**tags, "sidewalk": sides}))
    return result


def _is_alphabetic(name: str) -> bool:
    """Whether a name is in Latin, Greek or Cyrillic letters, which every plot's font has."""
    return all(ord(character) < 0x2000 for character in name)


def _lift(network: RoadNetwork, crossings: list[Crossing]) -> Lift:
    roads = []
    for road in network.roads:
        lane = network.lane_by_id[road.lanes[-1]]
        ends = (road.from_junction, road.to_junction)
        roads.append((lane.centre[:, :2], lane.level, frozenset(road.ways), ends))
    return lift_of_network(roads, crossings)
