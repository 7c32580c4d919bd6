"""The lane model: roads of reference lines, profiles and lane sections, joined at junctions."""

from urbantwin.roads.model.curve import Curve, Piece, all_turned, filleted, splined, turned
from urbantwin.roads.model.furniture import (
    CROSSING_MARKINGS,
    MINI_ROUNDABOUT,
    RoadArea,
    RoadSignal,
    SignalController,
)
from urbantwin.roads.model.lane_section import (
    CURB_HEIGHT_M,
    LANE_KINDS,
    RAISED_KINDS,
    LaneSection,
    SectionLane,
    turned_round,
)
from urbantwin.roads.model.model import Connection, LaneModel, ModelJunction, carriageway_in_plan
from urbantwin.roads.model.profile import Profile, fitted
from urbantwin.roads.model.road import ModelRoad, RoadLink

__all__ = [
    "CROSSING_MARKINGS",
    "CURB_HEIGHT_M",
    "LANE_KINDS",
    "MINI_ROUNDABOUT",
    "RAISED_KINDS",
    "Connection",
    "Curve",
    "LaneModel",
    "LaneSection",
    "ModelJunction",
    "ModelRoad",
    "Piece",
    "Profile",
    "RoadArea",
    "RoadLink",
    "RoadSignal",
    "SectionLane",
    "SignalController",
    "all_turned",
    "carriageway_in_plan",
    "filleted",
    "fitted",
    "splined",
    "turned",
    "turned_round",
]
