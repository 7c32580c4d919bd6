"""LiDAR: the sensor catalogue, beam patterns, rigs, casting, returns and labels of one frame."""

from urbantwin.lidar.actors import PosedActor
from urbantwin.lidar.catalogue import Sensor, load_sensor, sensor, sensor_names
from urbantwin.lidar.labels import BoxLabel, LabelledFrame
from urbantwin.lidar.pattern import beam_azimuths, beam_directions, beam_elevations
from urbantwin.lidar.rig import MountedSensor, Rig, place_rig
from urbantwin.lidar.scanner import Scanner

__all__ = [
    "BoxLabel",
    "LabelledFrame",
    "MountedSensor",
    "PosedActor",
    "Rig",
    "Scanner",
    "Sensor",
    "beam_azimuths",
    "beam_directions",
    "beam_elevations",
    "load_sensor",
    "place_rig",
    "sensor",
    "sensor_names",
]
