"""Siting: what roadside sensors see of their junction, and where one would see most of it."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.lidar.siting.from_map import place_in_sight, warnings_of_place
    from urbantwin.lidar.siting.junction_ground import CELL_M
    from urbantwin.lidar.siting.on_scene import stand_in_sight, standing_rig
    from urbantwin.lidar.siting.rig_sight import RigSight, SensorSight, sight_of_rig

__all__ = [
    "CELL_M",
    "RigSight",
    "SensorSight",
    "place_in_sight",
    "sight_of_rig",
    "stand_in_sight",
    "standing_rig",
    "warnings_of_place",
]

names_on_demand(__name__)
