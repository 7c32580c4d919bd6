"""The rig as CARLA's ray-cast LiDAR sensors."""

from __future__ import annotations

from typing import Any

import numpy as np

from urbantwin.errors import InputError
from urbantwin.exports.carla.frame import carla_transform
from urbantwin.lidar.rig import MountedSensor, Rig

__all__ = ["carla_rig", "carla_sensor"]

SEMANTIC, PLAIN = "sensor.lidar.ray_cast_semantic", "sensor.lidar.ray_cast"


def carla_rig(rig: Rig, *, blueprint: str = SEMANTIC) -> dict[str, Any]:
    """Return the rig's sensors for CARLA, and the server's time step, a frame of the rig.

    Args:
        rig: the rig, on its site.
        blueprint: ``SEMANTIC`` (a tag and an actor per point) or ``PLAIN`` (intensity, drop-out).

    Raises:
        InputError: a sensor without equivalent in CARLA, or a rig mounted on a vehicle, whose
            equivalent in CARLA is not known in advance.
    """
    if rig.ride is not None:
        raise InputError(
            "the rig is mounted on a vehicle, which is not exported", expected="a rig on the site"
        )
    return {
        "fixed_delta_seconds": 1.0 / rig.rate_hz,
        "sensors": [carla_sensor(one, blueprint=blueprint) for one in rig.sensors],
    }


def carla_sensor(mounted: MountedSensor, *, blueprint: str = SEMANTIC) -> dict[str, Any]:
    """Return a sensor: blueprint, attributes (text, as for CARLA), transform.

    CARLA spaces its channels evenly from ``upper_fov`` to ``lower_fov`` and fires them at once
    (``RayCastSemanticLidar.cpp``, ``CreateLasers``); it does not support a real sensor's table of
    elevations and azimuth offsets. ``largest_elevation_error_deg`` is the resulting error of the
    channels. All turns of a frame are fired within one step of the server.
    """
    model = mounted.sensor
    if model.pattern is not None:
        raise InputError(
            f"{model.name} scans a pattern, which CARLA's sensors cannot",
            expected="a sensor with channels",
        )
    elevation = np.sort(model.elevation_deg)
    even = np.linspace(elevation[0], elevation[-1], model.channels)
    attributes: dict[str, float] = {
        "channels": model.channels,
        "range": model.assumed_range_max_m,
        "points_per_second": round(model.channels * mounted.columns * mounted.turns_per_second),
        "rotation_frequency": mounted.turns_per_second,
        "upper_fov": round(float(elevation[-1]), 4),
        "lower_fov": round(float(elevation[0]), 4),
        "horizontal_fov": 360.0,
        "sensor_tick": 0.0,
    }
    if blueprint == PLAIN:
        # CARLA's own drop-out by intensity is off, since it models another sensor.
        sigma = model.assumed_range_sigma_m * mounted.calibration.range_noise
        sigma = sigma if mounted.effects.noise else 0.0
        attributes |= {"noise_stddev": sigma, "dropoff_general_rate": mounted.missing}
        attributes |= {"dropoff_intensity_limit": 0.0, "dropoff_zero_intensity": 0.0}
    return {
        "name": mounted.name,
        "model": model.name,
        "blueprint": blueprint,
        "attributes": {
            name: f"{value:g}" if name != "points_per_second" else f"{value:.0f}"
            for name, value in attributes.items()
        },
        "transform": carla_transform(mounted.site_SE3_sensor),
        "largest_elevation_error_deg": round(float(np.abs(even - elevation).max()), 3),
    }
