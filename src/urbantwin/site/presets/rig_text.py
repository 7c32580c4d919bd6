"""A preset's rig as the YAML of a ``site.yaml``, every value with its source beside it."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping

from urbantwin.site.presets.preset import Preset, PresetSensor
from urbantwin.site.presets.sensor_place import SensorPosition

__all__ = ["rig_text"]

_WIDE = 98
#: What a preset's fields are called in a rig.
_IN_RIG = {
    "frame_SE3_sensor": "place and angles",
    "blind_deg": "outages",
    "beside": "place",
    "offset_m": "place",
    "corner": "place",
}


def rig_text(preset: Preset, stands: Mapping[str, SensorPosition]) -> str:
    """Return the text of the mapping ``rig``, set in by two blanks.

    Args:
        preset: the place.
        stands: where each of its sensors stands.
    """
    lines = [f"  rate_hz: {preset.timing.rate_hz:g}", "  frame: level", "  boxes: track"]
    lines.append("  sensors:")
    for sensor in preset.sensors:
        lines += _sensor(sensor, stands[sensor.name], preset)
    return "\n".join(lines) + "\n"


def _sensor(sensor: PresetSensor, stand: SensorPosition, preset: Preset) -> Iterator[str]:
    for fields, text in sensor.sources.items():
        names = dict.fromkeys(_IN_RIG.get(name, name) for name in fields.split(", "))
        yield from _remark(f"{', '.join(names)}: {text}")
    for name, text in sensor.unknown.items():
        yield from _remark(f"unknown: {name}: {text}")
    if sensor.corner is not None:
        where = "" if sensor.corner in ("any", "opposite") else f" of the {sensor.corner}"
        yield from _remark(f"The pole{where} is proposed: it sees most of the junction on the map.")
    yield f"    - name: {sensor.name}"
    yield f"      model: {sensor.model}"
    if sensor.columns is not None:
        yield f"      columns: {sensor.columns}"
    if sensor.rate_hz is not None:
        yield f"      rate_hz: {sensor.rate_hz:g}"
    yield f"      east_m: {_number(stand.east_m)}"
    yield f"      north_m: {_number(stand.north_m)}"
    if stand.height_m is not None:
        yield f"      height_m: {_number(stand.height_m)}"
    if stand.up_m is not None:
        yield f"      up_m: {_number(stand.up_m)}"
    if stand.yaw_deg is not None:
        yield f"      yaw_deg: {_number(stand.yaw_deg)}"
    yield f"      pitch_deg: {_number(stand.pitch_deg)}"
    yield f"      roll_deg: {_number(stand.roll_deg)}"
    if sensor.blind_deg is not None:
        first, last = sensor.blind_deg
        yield "      outages:"
        yield f"        - sector_deg: [{first:g}, {last:g}]"
    if _may_move(sensor, preset):
        yield "      proposed: true    # a build moves it to where it sees more"


def _may_move(sensor: PresetSensor, preset: Preset) -> bool:
    """Return whether nothing is known of a sensor's place, nor hangs on it."""
    free = sensor.corner in ("any", "opposite") and sensor.height_m is None
    return free and not any(other.beside == sensor.name for other in preset.sensors)


def _remark(text: str) -> Iterator[str]:
    for line in textwrap.wrap(text, _WIDE - 8, break_on_hyphens=False, break_long_words=False):
        yield f"    # {line}"


def _number(value: float) -> str:
    return repr(round(value, 4) + 0.0)
