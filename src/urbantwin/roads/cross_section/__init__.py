"""Cross sections of roads: lanes from an OSM way's tags, and their input to netconvert."""

from urbantwin.roads.cross_section.from_tags import cross_section, reinterpreted
from urbantwin.roads.cross_section.netconvert_input import MappedSegment, PreparedWays, prepare_ways
from urbantwin.roads.cross_section.section import (
    CarriagewayLane,
    CrossSection,
    Parking,
    Roadside,
)
from urbantwin.roads.cross_section.sumo_edges import write_sumo_edges
from urbantwin.roads.cross_section.turn_lanes import SignedTurns

__all__ = [
    "CarriagewayLane",
    "CrossSection",
    "MappedSegment",
    "Parking",
    "PreparedWays",
    "Roadside",
    "SignedTurns",
    "cross_section",
    "prepare_ways",
    "reinterpreted",
    "write_sumo_edges",
]
