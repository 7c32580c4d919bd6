"""Assembling a frame from the fields of a file: their names, units of time, invalid points."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.fidelity.cloud_formats import position_and_intensity
from urbantwin.fidelity.clouds import UsablePoints, usable_points
from urbantwin.fidelity.frame import Frame

__all__ = ["frame_of", "seconds_of"]

#: Names of fields in lower case, the likelier first.
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
#: A frame lasts this long, seconds: determines the unit of its points' times.
_SHORTEST_S, _LONGEST_S = 1e-3, 2.0
#: Rings, columns and instances are less than this.
_LARGEST = 2.0**62
#: No sensor has more channels; what says so is read at the wrong place.
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
    """Return the frame that the fields of a file make up, without invalid points.

    Args:
        file: where they are from, for errors.
        fields: arrays (N,) by name in lower case; x, y, z must be among them. Intensity, ring,
            column and time are found by the names that writers give them.
        name: of the frame.
        given: arrays (N,) for attributes of `Frame` by their own names, in place of what is
            found.
        may_be_empty: whether a frame without a point is one, too.
        known: other attributes of `Frame`.

    Raises:
        InputError: x, y or z is missing, not a single point is left, or an array of ``given``
            has another length.
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
    """Refuse rings (N,) that are read at the wrong place: too large, or no whole numbers."""
    known = rings[np.isfinite(rings)].astype(np.float64)
    wrong = known[(known > _MOST_RINGS) | (known != np.round(known))]
    if len(wrong):
        raise InputError(
            f"has ring {wrong.max():.6g}",
            file=file,
            expected=f"0 to {_MOST_RINGS} (do its header's sizes and order say where the ring is?)",
        )


def _as_kept(attribute: str, values: NDArray[Any]) -> NDArray[Any]:
    """Return values as a frame keeps them: times, marks, else whole numbers, -1 for NaN."""
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
