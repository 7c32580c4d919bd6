"""How a dataset was made, as its card tells it: sensors, weather and effects, traffic."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from urbantwin.artefact.markdown import bullets, code, escaped, table
from urbantwin.dataset.reading.manifest import pose_of_matrix
from urbantwin.geometry import ypr_from_rotation

__all__ = ["making_of", "mapping"]

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
_CONDITIONS = {
    "visibility_m": "visibility, m",
    "wet_ground": "wet ground, 0 to 1",
    "sun_elevation_deg": "sun above the horizon, degrees",
    "sun_azimuth_deg": "sun, degrees clockwise from north",
}


def making_of(manifest: Mapping[str, Any]) -> Iterator[tuple[str, list[str]]]:
    """Yield sections of a card, each with its title and its lines of Markdown."""
    yield "Sensors", _sensors(manifest)
    yield "Weather and effects", _conditions(manifest["rig"])
    yield "Traffic", _traffic(manifest)


def mapping(value: Mapping[str, Any], *keys: str) -> Mapping[str, Any]:
    """Return a mapping within a manifest; an empty one where there is none."""
    found: Any = value
    for key in keys:
        found = found.get(key) if isinstance(found, Mapping) else None
    return found if isinstance(found, Mapping) else {}


def _sensors(manifest: Mapping[str, Any]) -> list[str]:
    rig = manifest["rig"]
    rows: list[list[object]] = []
    for one in rig["sensors"]:
        pose = pose_of_matrix(one["site_SE3_sensor"])
        turns = [f"{np.degrees(angle):.1f}" for angle in ypr_from_rotation(pose.rotation)]
        rows.append(
            [
                *(code(one["name"]), code(one["model"]), str(len(one["sensor"]["elevation_deg"]))),
                *(str(one["columns"]), f"{one.get('turns_per_second', rig['rate_hz']):g}"),
                *(f"{value + 0.0:.2f}" for value in pose.translation.tolist()),
                *turns,
            ]
        )
    heading = ["sensor", "model", "channels", "columns", "Hz"]
    heading += ["east", "north", "up", "yaw", "pitch", "roll"]
    lines = [
        *table(heading, rows, 9),
        "",
        "Metres from the anchor and degrees: yaw counter-clockwise from east, positive pitch tips "
        f"the nose down. Frames at {rig['rate_hz']:g} Hz"
        + (", points of all sensors in one frame" if len(rig["sensors"]) > 1 else "")
        + f"; boxes as `{rig.get('boxes', 'track')}`.",
    ]
    if manifest["dataset_SE3_site"] is None:
        lines += ["", "The rig rides: the poses are those at the start, every frame has its own."]
    odd = [f"{code(one['name'])}: {told}" for one in rig["sensors"] if (told := _faults(one))]
    return [*lines, "", *bullets(odd)] if odd else lines


def _faults(sensor: Mapping[str, Any]) -> str:
    found = []
    for name, usual in _USUAL.items():
        value = sensor.get(name, usual)
        if value != usual:
            shown = f"{value:g}" if isinstance(value, int | float) else "yes"
            found.append(f"{name} {shown}" if shown != "yes" else name)
    if isinstance(sensor.get("measured"), Mapping):
        found.append("its static world is what a real sensor measured")
    return escaped(", ".join(found)) if found else ""


def _conditions(rig: Mapping[str, Any]) -> list[str]:
    told = mapping(rig, "conditions")
    lines = [f"Weather: {escaped(told.get('weather', 'clear'))}."]
    for name, words in _CONDITIONS.items():
        if told.get(name) is not None and (
            name != "sun_azimuth_deg" or told.get("sun_elevation_deg") is not None
        ):
            lines.append(f"{words[0].upper()}{words[1:]}: {escaped(told[name])}.")
    if told.get("sun_elevation_deg") is None:
        lines.append("No sun is told: sunlight raises no noise.")
    ways: dict[str, list[str]] = {}
    for one in rig["sensors"]:
        ways.setdefault(_effects(mapping(one, "effects")), []).append(str(one["name"]))
    for effects, names in ways.items():
        whose = f" of {', '.join(map(code, names))}" if len(ways) > 1 else ""
        lines.append(f"Effects{whose}: {effects}.")
    return bullets(lines)


def _effects(told: Mapping[str, Any]) -> str:
    on = [code(name) for name, value in told.items() if value]
    off = [code(name) for name, value in told.items() if not value]
    parts = [f"{word}: {', '.join(names)}" for word, names in (("on", on), ("off", off)) if names]
    return "; ".join(parts) or "not told"


def _traffic(manifest: Mapping[str, Any]) -> list[str]:
    traffic = mapping(manifest, "about", "traffic")
    asked = mapping(manifest, "made_from", "motion", "asked")
    classes = traffic.get("classes")
    if not isinstance(classes, Mapping):  # datasets of older versions
        classes = {name: {"per_hour": rate} for name, rate in mapping(asked, "per_hour").items()}
    if isinstance(traffic.get("recorded"), Mapping):
        smoothing = escaped(traffic["recorded"].get("smoothing") or "not told")
        first = f"Recorded tracks of real road users, replayed; smoothing: {smoothing}."
    else:
        seed = manifest["seeds"].get("traffic")
        first = "Simulated by SUMO" + (f", seed {seed}." if seed is not None else ".")
    for words, value in (
        ("Length of the drive", traffic.get("duration_s", asked.get("duration_s"))),
        ("Before it, traffic fills the streets for", asked.get("warmup_s")),
    ):
        if _number(value):
            first += f" {words}: {value:g} s."
    mix = _class_mix(classes)
    return [first, "", *mix] if mix else [first]


def _class_mix(classes: Mapping[str, Any]) -> Sequence[str]:
    columns = {"per_hour": "asked for an hour", "driven": "driven", "seen": "in the region"}
    told = {name: row for name, row in classes.items() if isinstance(row, Mapping)}
    kept = [key for key in columns if any(_number(row.get(key)) for row in told.values())]
    rows: list[list[object]] = [
        [code(name), *(_number(row.get(key)) for key in kept)]
        for name, row in told.items()
        if any(_number(row.get(key)) for key in kept)
    ]
    return table(["class", *(columns[key] for key in kept)], rows, len(kept)) if rows else []


def _number(value: object) -> float | int | None:
    return value if isinstance(value, int | float) and not isinstance(value, bool) else None
