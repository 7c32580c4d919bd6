"""The rig that a dataset was recorded with, from its manifest: what `recipe_of_rig` wrote."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import BaseModel, ValidationError

from urbantwin.geometry import Pose
from urbantwin.lidar import MountedSensor, Rig, Sensor
from urbantwin.site.rig import Calibration, Conditions, Effects, OutageSpec, RideSpec, SwaySpec

__all__ = ["rig_of_manifest"]

_MODELS: dict[str, type[BaseModel]] = {
    "effects": Effects,
    "sway": SwaySpec,
    "calibration": Calibration,
}
#: Of a dataset's own place: not carried elsewhere.
_LEFT = ("measured", "model", "sensor")


def rig_of_manifest(manifest: Mapping[str, Any]) -> Rig | None:
    """Return the rig as it stood, or rode, when the dataset was recorded.

    Fields that an older manifest lacks have their defaults. A measured background is left out: it
    is of one place.

    Args:
        manifest: the content of ``dataset.json``.

    Returns:
        ``None`` where the manifest does not tell it: it is another's, damaged, or has a sensor
        whose scan pattern stands in a file of its own.
    """
    try:
        rig = manifest["rig"]
        return Rig(
            sensors=tuple(_mounted(one) for one in rig["sensors"]),
            frame=rig["frame"],
            rate_hz=float(rig["rate_hz"]),
            dataset_SE3_site=_pose(manifest["dataset_SE3_site"] or np.eye(4)),
            conditions=Conditions.model_validate(rig["conditions"]),
            ride=None if rig["ride"] is None else RideSpec.model_validate(rig["ride"]),
            carrier=rig["carrier"],
            fused=bool(rig["fused"]),
        )
    except (KeyError, TypeError, ValueError, AttributeError, ValidationError):
        return None


def _mounted(entry: Mapping[str, Any]) -> MountedSensor:
    known = {field.name for field in dataclasses.fields(MountedSensor)} - set(_LEFT)
    values = {name: value for name, value in entry.items() if name in known}
    for name, model in _MODELS.items():
        if values.get(name) is not None:
            values[name] = model.model_validate(values[name])
    values["outages"] = tuple(OutageSpec.model_validate(one) for one in values.get("outages", ()))
    for name in ("site_SE3_sensor", "carrier_SE3_sensor"):
        if values.get(name) is not None:
            values[name] = _pose(values[name])
    return MountedSensor(sensor=_sensor(entry["sensor"]), **values)


def _sensor(entry: Mapping[str, Any]) -> Sensor:
    if entry.get("pattern") is not None:
        raise ValueError("its scan pattern is not in the manifest")
    values: dict[str, Any] = {}
    for field in dataclasses.fields(Sensor):
        if field.name not in entry:
            continue
        value = entry[field.name]
        if value is not None and "NDArray" in str(field.type):
            value = np.array(value, np.float64)
        elif isinstance(value, list):
            value = tuple(tuple(one) if isinstance(one, list) else one for one in value)
        values[field.name] = value
    return Sensor(**values)


def _pose(rows: Any) -> Pose:  # noqa: ANN401
    matrix = np.array(rows, np.float64).reshape(4, 4)
    return Pose(matrix[:3, :3], matrix[:3, 3])
