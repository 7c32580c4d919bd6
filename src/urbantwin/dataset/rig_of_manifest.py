"""The rig of a dataset, from its manifest: the inverse of `recipe_of_rig`."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, Field, ValidationError

from urbantwin.artefact.manifest import Part
from urbantwin.dataset.reading.manifest import pose_of_matrix
from urbantwin.lidar import MountedSensor, Rig, Sensor
from urbantwin.lidar.rig import ReturnMode
from urbantwin.site.rig import (
    Calibration,
    Conditions,
    Effects,
    OutageSpec,
    PoseErrorSpec,
    RideSpec,
    SwaySpec,
)
from urbantwin.taxonomy import BoxKind

__all__ = ["rig_of_manifest"]

_MODELS: dict[str, type[BaseModel]] = {
    "effects": Effects,
    "sway": SwaySpec,
    "pose_error": PoseErrorSpec,
    "calibration": Calibration,
}
#: Fields that belong to the dataset's own place.
_LEFT = ("measured", "model", "sensor")
_LARGEST = 1e9
_Rate = Annotated[float, Field(gt=0, le=1000)]


def rig_of_manifest(manifest: Mapping[str, Any]) -> Rig | None:
    """Return the rig with which a dataset was recorded.

    Fields that an older manifest lacks have their defaults. A measured background is left out: it
    belongs to one place.

    Args:
        manifest: content of ``dataset.json``.

    Returns:
        ``None`` if the manifest does not describe it: another program's, damaged, or with a sensor
        whose scan pattern is in a separate file.
    """
    try:
        rig = manifest["rig"]
        _check_numbers(rig)
        _Told.model_validate(rig)
        return Rig(
            sensors=tuple(_mounted(entry) for entry in rig["sensors"]),
            frame=rig["frame"],
            rate_hz=float(rig["rate_hz"]),
            dataset_SE3_site=pose_of_matrix(manifest["dataset_SE3_site"] or np.eye(4)),
            conditions=Conditions.model_validate(rig["conditions"]),
            ride=None if rig["ride"] is None else RideSpec.model_validate(rig["ride"]),
            carrier=rig["carrier"],
            fused=bool(rig["fused"]),
            boxes=rig.get("boxes", "tight"),
            label_range_m=rig.get("label_range_m"),
        )
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError, ValidationError):
        return None


class _ToldSensor(Part):
    name: str
    columns: Annotated[int, Field(ge=1, le=65536)]
    number: Annotated[int, Field(ge=0, lt=256)] = 0
    rate_hz: _Rate = 10.0
    turns_per_second: _Rate = 10.0
    frame_window_s: Annotated[float, Field(gt=0, le=100)] = 0.1
    time_jitter_s: Annotated[float, Field(ge=0, le=1)] = 0.0
    latency_s: Annotated[float, Field(ge=0, le=10)] = 0.0
    dropped_frames: Annotated[float, Field(ge=0, le=1)] = 0.0
    returns: ReturnMode = "strongest"


class _Told(Part):
    """Numbers of a rig that decide the amount of work."""

    rate_hz: _Rate
    frame: Literal["sensor", "level", "site"]
    carrier: int | None
    fused: bool
    boxes: BoxKind = "tight"
    sensors: Annotated[list[_ToldSensor], Field(min_length=1, max_length=64)]


def _check_numbers(value: object) -> None:
    """Check all numbers, at any depth.

    Raises:
        ValueError: a number is not finite or huge.
    """
    if isinstance(value, dict | list):
        for item in value.values() if isinstance(value, dict) else value:
            _check_numbers(item)
    elif isinstance(value, int | float) and not abs(value) <= _LARGEST:
        raise ValueError(f"{value!r:.40} is not a value that a sensor has")


def _mounted(entry: Mapping[str, Any]) -> MountedSensor:
    names = {field.name for field in dataclasses.fields(MountedSensor)} - set(_LEFT)
    values = {name: value for name, value in entry.items() if name in names}
    for name, model in _MODELS.items():
        if values.get(name) is not None:
            values[name] = model.model_validate(values[name])
    values["outages"] = tuple(OutageSpec.model_validate(item) for item in values.get("outages", ()))
    for name in ("site_SE3_sensor", "carrier_SE3_sensor"):
        if values.get(name) is not None:
            values[name] = pose_of_matrix(values[name])
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
            value = tuple(tuple(item) if isinstance(item, list) else item for item in value)
        values[field.name] = value
    return Sensor(**values)
