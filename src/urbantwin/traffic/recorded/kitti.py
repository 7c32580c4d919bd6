"""Tracks as label files of KITTI's tracking task."""

from __future__ import annotations

import math
from pathlib import Path

from urbantwin.errors import InputError
from urbantwin.number_text import finite_number
from urbantwin.traffic.recorded.description import TracksSpec
from urbantwin.traffic.recorded.row_list import RowList
from urbantwin.traffic.recorded.track import RecordedRows

__all__ = ["kitti_rows"]

_EXPECTED = "a label file of KITTI tracking: 17 fields a line, 18 with a score"
_FIELDS = (17, 18)
_RATE_HZ = 10.0  # KITTI's own


def kitti_rows(path: Path, spec: TracksSpec) -> RecordedRows:
    """Read tracks of a sensor that stands.

    A line is frame, track, type, truncation, occlusion, alpha, box in the picture (4), height,
    width, length, x, y, z of the bottom's middle in the camera's frame (x right, y down, z
    ahead), rotation about its y (KITTI development kit, tracking, readme). Returned is x ahead, y
    left: ``pose:`` of a description says where that frame stands in the site.

    Raises:
        InputError: the file is missing, or a line is none.
    """
    try:
        lines = path.read_bytes().decode("utf-8").splitlines()
    except FileNotFoundError:
        raise InputError("not found", file=path, expected=_EXPECTED) from None
    except (OSError, UnicodeDecodeError):
        raise InputError("is not readable text", file=path, expected=_EXPECTED) from None
    rows, rate_hz = RowList(path, _EXPECTED), spec.rate_hz or _RATE_HZ
    for number, line in enumerate(lines, 1):
        fields = line.split()
        if not fields:
            continue
        place = f"line {number}"
        if len(fields) not in _FIELDS:
            raise rows.error(place, f"has {len(fields)} fields")
        values = [finite_number(fields[k]) for k in (0, 1, *range(10, 17))]
        frame, track, height, width, length, right, down, ahead, turned = (
            math.nan if value is None else value for value in values
        )
        if track < 0:  # "DontCare" belongs to nobody
            continue
        if math.isnan(sum((frame, track, height, width, length, right, down, ahead, turned))):
            raise rows.error(place, "holds something else than numbers")
        yaw = -turned - math.pi / 2
        size = (length, width, height)
        name, xyz = str(int(track)), (ahead, -right, -down)
        rows.add(place, name, frame / rate_hz, fields[2], xyz, yaw, size)
    return rows.made()
