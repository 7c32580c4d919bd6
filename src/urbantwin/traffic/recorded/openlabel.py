"""Tracks as ASAM OpenLABEL 1.0 (JSON): objects with a cuboid in every frame."""

from __future__ import annotations

import datetime
import math
from pathlib import Path
from typing import Any

from urbantwin.artefact.document import read_json_value
from urbantwin.traffic.recorded.description import TracksSpec
from urbantwin.traffic.recorded.row_list import RowList, yaw_of_quaternion
from urbantwin.traffic.recorded.track import RecordedRows

__all__ = ["openlabel_rows"]

_EXPECTED = "ASAM OpenLABEL 1.0 with cuboids"
_ENOUGH = (9, 10)


def openlabel_rows(path: Path, spec: TracksSpec) -> RecordedRows:
    """Read tracks from OpenLABEL.

    A cuboid's values are x, y, z of its middle, a quaternion x, y, z, w or angles about x, y, z,
    and its sizes along x, y, z (ASAM OpenLABEL 1.0.0, 7.4.5 "Cuboid"). Frames have times
    (``frame_properties.timestamp``: seconds, or a date), or follow each other by ``rate_hz``.

    Raises:
        InputError: the file is missing, or is none; the object and frame are named.
    """
    whole = read_json_value(path, _EXPECTED)
    rows = RowList(path, _EXPECTED)
    top = whole.get("openlabel") if isinstance(whole, dict) else None
    frames = top.get("frames") if isinstance(top, dict) else None
    if not isinstance(top, dict) or not isinstance(frames, dict):
        raise rows.error("openlabel.frames", "is missing")
    kinds = {
        name: str(item["type"])
        for name, item in _mapping(top.get("objects")).items()
        if isinstance(item, dict) and "type" in item
    }
    for number, frame in frames.items():
        place = f"openlabel.frames.{number}"
        time_s = _time(rows, place, number, _mapping(frame), spec)
        for name, item in _mapping(_mapping(frame).get("objects")).items():
            data = _mapping(_mapping(item).get("object_data"))
            cuboid = data.get("cuboid")
            first = cuboid[0] if isinstance(cuboid, list) and cuboid else cuboid
            values = _mapping(first).get("val")
            if values is None:
                continue
            here = f"{place}.objects.{name}.object_data.cuboid"
            if not isinstance(values, list) or len(values) not in _ENOUGH:
                raise rows.error(here, "has not 9 or 10 values")
            if not all(isinstance(one, int | float) for one in values):
                raise rows.error(here, "holds something else than numbers")
            if len(values) == _ENOUGH[1]:
                yaw = yaw_of_quaternion(values[6], *values[3:6])
            else:
                yaw = float(values[5])
            kind = kinds.get(name) or str(data.get("type", "unknown"))
            rows.add(here, name, time_s, kind, values[:3], yaw, values[-3:])
    return rows.made()


def _time(rows: RowList, place: str, number: str, frame: dict[str, Any], spec: TracksSpec) -> float:
    stamp = _mapping(frame.get("frame_properties")).get("timestamp")
    if spec.rate_hz is None and stamp is not None:
        try:
            value = float(stamp)
        except (TypeError, ValueError):
            pass
        else:
            if math.isfinite(value):
                return value
        try:
            date = datetime.datetime.fromisoformat(str(stamp))
        except ValueError:
            problem = f"has the time {str(stamp)[:40]!r}"
            raise rows.error(f"{place}.frame_properties.timestamp", problem) from None
        return (date.replace(tzinfo=date.tzinfo or datetime.UTC)).timestamp()
    if spec.rate_hz is None:
        raise rows.error(place, "has no time, and the description no rate_hz")
    if not number.isdigit():
        raise rows.error(place, "is not a frame's number")
    return int(number) / spec.rate_hz


def _mapping(value: object) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}
