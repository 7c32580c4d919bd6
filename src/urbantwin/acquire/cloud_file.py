"""Points of a survey from several files, written as one LAZ file."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS

from urbantwin.acquire.web import NotAcquiredError, NothingThereError

__all__ = ["MOST_POINTS", "inside_box", "write_cloud"]

#: More points than this are more than a site's reconstruction takes.
MOST_POINTS = 40_000_000
#: Steps of coordinates: in units of length, and in degrees.
_STEP, _STEP_DEG = 0.001, 1e-8
#: What is kept of a point, where its file has it.
_FIELDS = (
    "intensity", "return_number", "number_of_returns", "classification", "withheld", "synthetic",
    "scan_angle", "gps_time", "point_source_id",
)  # fmt: skip
_COLOURS = ("red", "green", "blue")


def inside_box(
    points: Any,  # noqa: ANN401 - laspy's records
    box: tuple[float, float, float, float],
) -> NDArray[np.bool_]:
    """Return which points lie in west, south, east, north of their own CRS."""
    x, y = np.asarray(points.x), np.asarray(points.y)
    west, south, east, north = box
    return np.asarray((x >= west) & (x <= east) & (y >= south) & (y <= north))


def write_cloud(parts: Sequence[Any], crs: CRS, path: Path) -> int:
    """Write points as LAZ (format 6, or 7 with colours), and return how many there are.

    Args:
        parts: records of laspy, of one CRS.
        crs: theirs.
        path: the file.

    Raises:
        NotAcquiredError: there is none, or too many, or they are too far apart.
    """
    import laspy

    parts = [one for one in parts if len(one)]
    total = sum(len(one) for one in parts)
    if not total:
        raise NothingThereError("has no points there")
    if total > MOST_POINTS:
        raise NotAcquiredError(f"has {total:,} points there, more than {MOST_POINTS:,}")
    names = [set(one.point_format.dimension_names) for one in parts]
    has_colours = all({*_COLOURS} <= one for one in names)
    header = laspy.LasHeader(point_format=7 if has_colours else 6, version="1.4")
    # A date of today would make the same points another file tomorrow.
    header.creation_date = None
    header.generating_software = "urbantwin"
    step = _STEP_DEG if crs.is_geographic else _STEP
    x, y, z = (np.concatenate([np.asarray(getattr(one, axis)) for one in parts]) for axis in "xyz")
    header.offsets = np.floor([x.min(), y.min(), z.min()])
    header.scales = np.array([step, step, _STEP])
    header.add_crs(crs)
    cloud = laspy.LasData(header)
    try:
        cloud.x, cloud.y, cloud.z = x, y, z
    except OverflowError:  # LAS keeps steps from the offset in 32 bits
        raise NotAcquiredError("has points too far apart to be of one place") from None
    for name in (*_FIELDS, *(_COLOURS if has_colours else ())):
        values = [_field(one, name, has) for one, has in zip(parts, names, strict=True)]
        cloud[name] = np.concatenate(values)
    packed = io.BytesIO()
    cloud.write(packed, do_compress=True, laz_backend=laspy.LazBackend.Lazrs)
    path.write_bytes(packed.getvalue())
    return total


def _field(part: Any, name: str, names: set[str]) -> NDArray[Any]:  # noqa: ANN401
    """Return a field of a record; zeros where its format has none."""
    if name in names:
        return np.asarray(part[name])
    if name == "scan_angle" and "scan_angle_rank" in names:
        # Formats 0 to 5 have whole degrees, 6 to 10 steps of 0.006 degrees (LAS 1.4 R15).
        return np.asarray(np.asarray(part["scan_angle_rank"], np.float64) / 0.006).astype(np.int16)
    return np.zeros(len(part), np.float64 if name == "gps_time" else np.uint8)
