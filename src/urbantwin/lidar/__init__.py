"""LiDAR: the sensor catalogue, beam patterns, rigs, casting, returns and labels of one frame."""

from urbantwin.lidar.catalogue import Sensor, load_sensor, sensor, sensor_names
from urbantwin.lidar.pattern import beam_azimuths, beam_directions, beam_elevations

__all__ = [
    "Sensor",
    "beam_azimuths",
    "beam_directions",
    "beam_elevations",
    "load_sensor",
    "sensor",
    "sensor_names",
]
