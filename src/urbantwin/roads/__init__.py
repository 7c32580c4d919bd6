"""The roads of a site: the lane model, from OpenStreetMap or an imported map, with heights."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.roads.build import BuiltRoads, build_roads
    from urbantwin.roads.driving_side import driving_side
    from urbantwin.roads.grade_separation import Lift
    from urbantwin.roads.heights import RoadSurface
    from urbantwin.roads.model import LaneModel
    from urbantwin.roads.netconvert import sumo_binary, sumo_environment, sumo_home
    from urbantwin.roads.network import (
        BusStop,
        Junction,
        Lane,
        Road,
        RoadNetwork,
        SignalHead,
        SignalProgram,
        Track,
    )

__all__ = [
    "BuiltRoads",
    "BusStop",
    "Junction",
    "Lane",
    "LaneModel",
    "Lift",
    "Road",
    "RoadNetwork",
    "RoadSurface",
    "SignalHead",
    "SignalProgram",
    "Track",
    "build_roads",
    "driving_side",
    "sumo_binary",
    "sumo_environment",
    "sumo_home",
]

names_on_demand(__name__)
