"""Assembly of a frame from the fields of a file: names, units of time, invalid points."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.fidelity.clouds import UsablePoints, usable_points
from urbantwin.fidelity.frame import Frame
from urbantwin.io.points import position_and_intensity

__all__ = ["frame_of", "seconds_of"]

#: Names of fields in lower case, the most likely first.
_NAMES = {
    "ring": ("ring", "laser_number", "laser_id", "channel", "ray", "line"),
    "column": ("column", "measurement_id"),
    "time_s": (
        "t",
        "time",
        "timestamp",
        "offset_ns",
        "time_offset",
        "offset_time",
        "time_stamp",
        "gps_time",
    ),
}
#: Bounds of a frame's duration, seconds, which determine the unit of times.
_SHORTEST_S, _LONGEST_S = 1e-3, 2.0
#: Bound of rings, columns and instances.
_LARGEST = 2.0**62
#: Maximum ring number of a sensor; larger ones are read at a wrong offset.
_MOST_RINGS = 4095


def frame_of(
    file: Path,
    fields: Mapping[str, NDArray[np.generic]],
    *,
    name: str,
    given: Mapping[str, NDArray[np.generic]] | None = None,
    may_be_empty: bool = False,
    **known: Any,  # noqa: ANN401 - attributes of a frame
) -> Frame:
    """Return the frame of a file's fields, without invalid points.

    Args:
        file: the file, for errors.
        fields: arrays (N,) by name in lower case; x, y, z are required. Intensity, ring, column and
            time are found by their usual names.
        name: name of the frame.
        given: arrays (N,) for attributes of `Frame` by their names; they replace fields.
        may_be_empty: whether a frame without a point is allowed.
        known: other attributes of `Frame`.

    Raises:
        InputError: x, y or z is missing, no point is left, or an array of ``given`` has another
            length.
    """
    table, intensity = position_and_intensity(file, fields)
    found: dict[str, NDArray[Any]] = {}
    for attribute, names in _NAMES.items():
        for one in names:
            if one in fields:
                values: NDArray[Any] | None = fields[one]
                if attribute == "time_s":
                    values = seconds_of(fields[one])
                if values is not None:
                    found[attribute] = values
                break
    found |= dict(given or {})
    for attribute, values in found.items():
        if values.dtype.kind not in "fiub":
            raise InputError(f"has {attribute} of {values.dtype}", file=file, expected="numbers")
        if values.shape != (len(table),):
            raise InputError(
                f"{len(values)} values of {attribute} for {len(table)} points", file=file
            )
    if may_be_empty and not len(table):
        usable = UsablePoints(np.zeros(0, bool), 0, 0)
    else:
        usable = usable_points(file, table, intensity)
    if "ring" in found:
        _check_rings(file, found["ring"][usable.rows])
    of_points: dict[str, Any] = {
        attribute: _as_kept(attribute, values[usable.rows])
        for attribute, values in found.items()
        if attribute != "intensity"
    }
    if "intensity" in found:
        intensity = found["intensity"].astype(np.float64)
    return Frame(
        points=table[usable.rows],
        intensity=None if intensity is None else intensity[usable.rows],
        name=name,
        not_finite=usable.not_finite,
        no_return=usable.no_return,
        **of_points,
        **known,
    )


def _check_rings(file: Path, rings: NDArray[Any]) -> None:
    """Raise an error for rings (N,) that are read at a wrong offset: too large, or not whole."""
    known = rings[np.isfinite(rings)].astype(np.float64)
    wrong = known[(known > _MOST_RINGS) | (known != np.round(known))]
    if len(wrong):
        raise InputError(
            f"has ring {wrong.max():.6g}",
            file=file,
            expected=f"0 to {_MOST_RINGS} (do its header's sizes and order say where the ring is?)",
        )


def _as_kept(attribute: str, values: NDArray[Any]) -> NDArray[Any]:
    """Return values in the type of the attribute: float, bool, or whole numbers with -1 for NaN."""
    if attribute == "time_s":
        return values.astype(np.float64)
    if attribute == "unlabelled":
        return values.astype(bool)
    if values.dtype.kind == "f":
        values = np.where(np.abs(values) < _LARGEST, values, -1)
    return values.astype(np.int64)


def seconds_of(values: NDArray[np.generic]) -> NDArray[np.float64] | None:
    """Return times (N,) as seconds from the first, or None where their unit is ambiguous.

    Drivers write seconds (Velodyne, Hesai, RoboSense), milliseconds, microseconds (LUMPI) or
    nanoseconds (Ouster, Argoverse), from the frame's start or from 1970. A frame lasts
    between 1 ms and 2 s in only one of these units.
    """
    if values.dtype.kind not in "fiu":
        return None
    times = values.astype(np.float64)
    finite = times[np.isfinite(times)]
    if not len(finite):
        return None
    times = times - finite.min()
    span = float(np.ptp(finite))
    for unit in (1.0, 1e-3, 1e-6, 1e-9):
        if _SHORTEST_S <= span * unit <= _LONGEST_S:
            return np.asarray(np.nan_to_num(times) * unit)
    return None
