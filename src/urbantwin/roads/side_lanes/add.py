"""Adding side lanes to the lane model."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import replace

import shapely
from numpy.typing import ArrayLike

from urbantwin.roads.cross_section import MappedSegment
from urbantwin.roads.model import LaneModel, ModelRoad
from urbantwin.roads.side_lanes.clearance import Clearance
from urbantwin.roads.side_lanes.island import BEYOND_M, islands_on, moved_aside, stations_on
from urbantwin.roads.side_lanes.lane_insertion import Renumbering, relinked, with_lanes
from urbantwin.roads.side_lanes.map_matching import by_way, match_ways
from urbantwin.roads.side_lanes.median import medians
from urbantwin.roads.side_lanes.parking import parking_and_shoulders

__all__ = ["add_side_lanes"]


def add_side_lanes(
    model: LaneModel,
    segments: Iterable[MappedSegment],
    *,
    country: str = "",
    obstacles: Sequence[shapely.Polygon] = (),
    crossings: ArrayLike = (),
    islands: ArrayLike = (),
) -> LaneModel:
    """Return the model with parking lanes, shoulders, medians and islands on its streets.

    They lie between the carriageway and the sidewalk, which moves outwards along them, and between
    the carriageways of dual streets. Junctions stay as they are: side lanes taper to nothing
    before them. Ids are counted anew from the reference line outwards; strips stay.

    Args:
        model: roads in plan, before heights and before anything stands on them.
        segments: the ways that streets are made from, with their cross sections.
        country: ISO 3166-1 alpha-2, for the law on parking; empty if unknown.
        obstacles: areas that no road may grow into, such as buildings, site frame.
        crossings: (N, 2) where people cross streets: there is no parking.
        islands: (N, 2) where they cross with a refuge in the middle.
    """
    ways = by_way(segments)
    meeting: dict[int, set[int]] = defaultdict(set)
    streets = [road for road in model.roads if road.junction < 0]
    for road in streets:
        for link in (road.predecessor, road.successor):
            if link is not None and link.element == "junction":
                meeting[link.id].add(road.id)
    room = Clearance(model, obstacles)
    between = medians(model, room.footprints)
    changed: dict[int, Renumbering] = {}
    roads: dict[int, ModelRoad] = {}
    for road in streets:
        meets = {}
        for end, link in (("start", road.predecessor), ("end", road.successor)):
            if link is None:
                meets[end] = "nothing"
            elif link.element == "junction" and len(meeting[link.id]) > 2:
                meets[end] = "junction"
            else:
                meets[end] = "street"
        refuges = islands_on(road, stations_on(road, islands, beyond=BEYOND_M), room)
        parts = match_ways(road, ways)
        clear = stations_on(road, crossings)
        items = parking_and_shoulders(road, parts, meets, clear, room=room, country=country)
        taken = {item.side for item in items}
        items += [item for item in between.get(road.id, []) if item.side not in taken]
        items += refuges
        if items:
            wider, changed[road.id] = with_lanes(road, items)
            roads[road.id] = moved_aside(wider, refuges) if refuges else wider
    if not roads:
        return model
    whole = replace(model, roads=tuple(roads.get(road.id, road) for road in model.roads))
    return relinked(whole, changed)
