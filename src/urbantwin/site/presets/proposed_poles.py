"""Poles for sensors of which nobody published the place."""

from __future__ import annotations

from dataclasses import replace

from urbantwin.geometry import SiteFrame
from urbantwin.site.pole_site import PoleChoice, PoleGround
from urbantwin.site.presets.preset import Corner, Preset, PresetSensor
from urbantwin.site.presets.sensor_place import SensorPosition, site_position

__all__ = ["stand_of_sensors"]

#: Signs of east and north in each quarter.
_QUARTERS = {
    "north-east": (1, 1), "north-west": (-1, 1), "south-west": (-1, -1), "south-east": (1, -1),
}  # fmt: skip


def stand_of_sensors(
    preset: Preset, ground: PoleGround, site: SiteFrame, choose_pole: PoleChoice
) -> dict[str, SensorPosition]:
    """Return where each sensor of a preset stands.

    Args:
        preset: the place.
        ground: where poles may stand.
        site: the site frame.
        choose_pole: what chooses among the places of a ground.
    """
    stands: dict[str, SensorPosition] = {}
    quarter: tuple[int, int] | None = None
    for sensor in preset.sensors:
        if sensor.is_placed:
            stands[sensor.name] = site_position(sensor, preset.frame, site)
        elif sensor.beside is not None:
            stands[sensor.name] = _beside(stands[sensor.beside], sensor)
        else:
            wanted = _signs(sensor.corner or "any", quarter)
            pole = choose_pole(replace(ground, quarter=wanted))
            quarter = (1 if pole.east_m >= 0 else -1, 1 if pole.north_m >= 0 else -1)
            height = sensor.height_m or pole.height_m
            stands[sensor.name] = SensorPosition(
                pole.east_m, pole.north_m, None, height, pole.yaw_deg, pole.pitch_deg, 0.0
            )
    return stands


def _signs(corner: Corner, before: tuple[int, int] | None) -> tuple[int, int] | None:
    if corner == "opposite" and before is not None:
        return -before[0], -before[1]
    return _QUARTERS.get(corner)


def _beside(pole: SensorPosition, sensor: PresetSensor) -> SensorPosition:
    east, north, up = sensor.offset_m or (0.0, 0.0, 0.0)
    height = None if pole.height_m is None else pole.height_m + up
    above = None if pole.up_m is None else pole.up_m + up
    return replace(
        pole,
        east_m=pole.east_m + east,
        north_m=pole.north_m + north,
        height_m=height,
        up_m=above,
        roll_deg=sensor.roll_deg,
    )
