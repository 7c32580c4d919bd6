"""Side lanes: parking, shoulders, medians and curbs beside the traffic lanes."""

from urbantwin.roads.side_lanes.add import add_side_lanes
from urbantwin.roads.side_lanes.clearance import before_buildings, corners_before_buildings
from urbantwin.roads.side_lanes.island import is_island, with_island_areas
from urbantwin.roads.side_lanes.lane_insertion import with_curbs
from urbantwin.roads.side_lanes.moved_curb import CurbMove, with_moved_curbs

__all__ = [
    "CurbMove",
    "add_side_lanes",
    "before_buildings",
    "corners_before_buildings",
    "is_island",
    "with_curbs",
    "with_island_areas",
    "with_moved_curbs",
]
