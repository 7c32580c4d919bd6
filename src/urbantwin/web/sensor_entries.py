"""Sensors as drawn on the page: poses and fields of view."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from urbantwin.fidelity.frame import Frame
from urbantwin.geometry import Pose

__all__ = ["sensors_of_frame", "sensors_of_manifest", "sensors_of_rig"]

#: Drawn range of sensors with unknown range, metres.
_UNKNOWN_RANGE_M = 50.0


def sensors_of_manifest(
    sensors: Sequence[Mapping[str, Any]], scene_SE3_site: Pose | None
) -> list[dict[str, Any]]:
    """Return the sensors of a dataset's manifest."""
    found = []
    for one in sensors:
        rows = one.get("site_SE3_sensor")
        sheet = one.get("sensor") or {}
        if rows is None:
            continue
        pose = np.array(rows, float)
        if scene_SE3_site is not None:
            pose = _matrix(scene_SE3_site) @ pose
        found.append(_entry(one["name"], one["model"], pose, sheet, one.get("columns")))
    return found


def sensors_of_rig(rig: Any, scene_SE3_site: Pose | None) -> list[dict[str, Any]]:  # noqa: ANN401
    """Return the sensors of a placed `lidar.Rig`."""
    found = []
    for one in rig.sensors:
        pose = one.site_SE3_sensor
        if scene_SE3_site is not None:
            pose = scene_SE3_site @ pose
        sheet = {
            "elevation_deg": np.asarray(one.sensor.elevation_deg, float).tolist(),
            "range_max_m": float(one.sensor.range_max_m),
        }
        found.append(_entry(one.name, one.sensor.name, _matrix(pose), sheet, one.columns))
    return found


def sensors_of_frame(frame: Frame) -> list[dict[str, Any]]:
    """Return the sensors of a recording with positions only; fields of view are measured."""
    found = []
    for number, place in enumerate(frame.sensor_places):
        mine = frame.points
        if frame.sensor is not None and len(frame.sensor_places) > 1:
            mine = mine[frame.sensor == number]
        away = mine - place
        distance = np.linalg.norm(away, axis=1)
        ring = frame.ring if frame.ring is not None else np.zeros(0, np.int64)
        pose = np.eye(4)
        pose[:3, 3] = place
        sheet: dict[str, Any] = {"range_max_m": _UNKNOWN_RANGE_M}
        if len(mine):
            up = np.degrees(np.arcsin(np.clip(away[:, 2] / np.maximum(distance, 1e-6), -1, 1)))
            sheet["elevation_deg"] = np.percentile(up, [1, 99]).tolist()
            sheet["range_max_m"] = float(np.percentile(distance, 99))
        entry = _entry(f"sensor {number + 1}" if number else "sensor", "", pose, sheet, None)
        entry["channels"] = int(ring.max(initial=-1)) + 1
        column = frame.column if frame.column is not None else np.zeros(0, np.int64)
        entry["columns"] = int(column.max(initial=-1)) + 1
        found.append(entry)
    return found


def _matrix(pose: Pose) -> Any:  # noqa: ANN401
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = pose.rotation, pose.translation
    return matrix


def _entry(
    name: str,
    model: str,
    pose: Any,  # noqa: ANN401
    sheet: Mapping[str, Any],
    columns: int | None,
) -> dict[str, Any]:
    elevation = [float(one) for one in sheet.get("elevation_deg") or (-15.0, 15.0)]
    azimuth = sheet.get("azimuth_deg")
    limits = [float(one) for one in azimuth] if azimuth and len(azimuth) == 2 else None
    return {
        "name": str(name),
        "model": str(model),
        "pose": [round(float(one), 9) for one in np.asarray(pose).ravel()],
        "elevation_deg": [round(min(elevation), 3), round(max(elevation), 3)],
        "azimuth_deg": limits,
        "range_m": round(float(sheet.get("range_max_m") or _UNKNOWN_RANGE_M), 3),
        "channels": len(elevation) if len(elevation) > 2 else 0,
        "columns": int(columns or 0),
    }
