"""Cross sections: what a way's tags say of its lanes, and how the network gets them."""

from urbantwin.roads.cross_section.from_tags import cross_section
from urbantwin.roads.cross_section.netconvert_input import MappedStretch, PreparedWays, prepare_ways
from urbantwin.roads.cross_section.section import (
    CarriagewayLane,
    CrossSection,
    Parking,
    Roadside,
)
from urbantwin.roads.cross_section.sumo_edges import write_sumo_edges

__all__ = [
    "CarriagewayLane",
    "CrossSection",
    "MappedStretch",
    "Parking",
    "PreparedWays",
    "Roadside",
    "cross_section",
    "prepare_ways",
    "write_sumo_edges",
]
