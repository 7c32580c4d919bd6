"""The card's account of how a dataset was made: sensors, effects, traffic."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from urbantwin.dataset.reading.manifest import pose_of_matrix
from urbantwin.geometry import ypr_from_rotation

__all__ = ["durations_of", "effects_of", "mapping", "mix_of", "sensors_of", "weather_of"]

#: What a sensor does without being told so; what is other is worth a line.
_USUAL: Mapping[str, object] = {
    "clock_offset_s": 0.0,
    "clock_drift_ppm": 0.0,
    "time_jitter_s": 0.0,
    "latency_s": 0.0,
    "dropped_frames": 0.0,
    "outages": [],
    "sway": None,
    "pose_error": None,
    "framed_by_clock": False,
    "phase_deg": 0.0,
    "deskew": True,
}
_WEATHER = {
    "visibility_m": "Visibility, m",
    "wet_ground": "Wet ground, 0 to 1",
    "sun_elevation_deg": "Sun above the horizon, degrees",
    "sun_azimuth_deg": "Sun, degrees clockwise from north",
}
_TRAFFIC = {"per_hour": "asked for an hour", "driven": "driven", "seen": "in the region"}


def mapping(value: Mapping[str, Any], *keys: str) -> Mapping[str, Any]:
    """Return a mapping within a manifest; an empty one where there is none."""
    found: Any = value
    for key in keys:
        found = found.get(key) if isinstance(found, Mapping) else None
    return found if isinstance(found, Mapping) else {}


def sensors_of(manifest: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return each sensor: what it is, its pose at the start, and what is unusual about it."""
    rig, rows = manifest["rig"], []
    for one in rig["sensors"]:
        pose = pose_of_matrix(one["site_SE3_sensor"])
        turns = np.degrees(ypr_from_rotation(pose.rotation))
        rows.append(
            {
                "name": one["name"],
                "model": one["model"],
                "channels": len(one["sensor"]["elevation_deg"]),
                "columns": one["columns"],
                "rate_hz": one.get("turns_per_second", rig["rate_hz"]),
                "pose": [f"{value + 0.0:.2f}" for value in pose.translation.tolist()],
                "turned": [f"{angle:.1f}" for angle in turns],
                "faults": _faults(one),
            }
        )
    return rows


def _faults(sensor: Mapping[str, Any]) -> list[str]:
    found = []
    for name, usual in _USUAL.items():
        value = sensor.get(name, usual)
        if value != usual:
            found.append(f"{name} {value:g}" if isinstance(value, int | float) else name)
    if isinstance(sensor.get("measured"), Mapping):
        found.append("its static world is what a real sensor measured")
    return found


def weather_of(rig: Mapping[str, Any]) -> list[tuple[str, Any]]:
    """Return the stated parameters of the weather, with their labels."""
    told = mapping(rig, "conditions")
    sun = told.get("sun_elevation_deg") is not None
    return [
        (words, told[name])
        for name, words in _WEATHER.items()
        if told.get(name) is not None and (name != "sun_azimuth_deg" or sun)
    ]


def effects_of(
    rig: Mapping[str, Any],
) -> dict[tuple[tuple[str, tuple[str, ...]], ...], list[str]]:
    """Return which effects are on and off, with the sensors of which they are so."""
    found: dict[tuple[tuple[str, tuple[str, ...]], ...], list[str]] = {}
    for one in rig["sensors"]:
        told = mapping(one, "effects")
        on = tuple(name for name, value in told.items() if value)
        off = tuple(name for name, value in told.items() if not value)
        parts = tuple((word, names) for word, names in (("on", on), ("off", off)) if names)
        found.setdefault(parts, []).append(str(one["name"]))
    return found


def durations_of(manifest: Mapping[str, Any]) -> list[tuple[str, float | None]]:
    """Return how long the traffic was driven."""
    traffic = mapping(manifest, "about", "traffic")
    asked = mapping(manifest, "made_from", "motion", "asked")
    return [
        ("Length of the drive", _number(traffic.get("duration_s", asked.get("duration_s")))),
        ("Before it, traffic fills the streets for", _number(asked.get("warmup_s"))),
    ]


def mix_of(manifest: Mapping[str, Any]) -> tuple[list[str], dict[str, list[float | None]]]:
    """Return the columns of the table of classes of traffic, and the row of each class."""
    classes = mapping(manifest, "about", "traffic").get("classes")
    if not isinstance(classes, Mapping):  # datasets of older versions
        rates = mapping(manifest, "made_from", "motion", "asked", "per_hour")
        classes = {name: {"per_hour": rate} for name, rate in rates.items()}
    rows = {
        name: {key: _number(row.get(key)) for key in _TRAFFIC}
        for name, row in classes.items()
        if isinstance(row, Mapping)
    }
    rows = {name: row for name, row in rows.items() if any(row.values())}
    kept = [key for key in _TRAFFIC if any(row[key] for row in rows.values())]
    return [_TRAFFIC[key] for key in kept], {
        name: [row[key] for key in kept] for name, row in rows.items()
    }


def _number(value: object) -> float | None:
    return value if isinstance(value, int | float) and not isinstance(value, bool) else None
