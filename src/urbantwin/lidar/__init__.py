"""LiDAR: the sensor catalogue, beam patterns, rigs, casting, returns and labels of one frame."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.lidar.actor_path import PosedActor
    from urbantwin.lidar.catalogue import (
        Sensor,
        load_sensor,
        nominal_sensor_names,
        sensor,
        sensor_names,
    )
    from urbantwin.lidar.labels import BoxLabel, LabelledFrame
    from urbantwin.lidar.pattern import (
        beam_azimuths,
        beam_directions,
        beam_elevations,
        pattern_directions,
    )
    from urbantwin.lidar.placement import place_rig
    from urbantwin.lidar.rig import MountedSensor, Rig
    from urbantwin.lidar.scan_pattern import ScanPattern, load_scan_pattern
    from urbantwin.lidar.scanner import Scanner

__all__ = [
    "BoxLabel",
    "LabelledFrame",
    "MountedSensor",
    "PosedActor",
    "Rig",
    "ScanPattern",
    "Scanner",
    "Sensor",
    "beam_azimuths",
    "beam_directions",
    "beam_elevations",
    "load_scan_pattern",
    "load_sensor",
    "nominal_sensor_names",
    "pattern_directions",
    "place_rig",
    "sensor",
    "sensor_names",
]

names_on_demand(__name__)
