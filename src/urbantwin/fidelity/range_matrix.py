"""A background from an external matrix of ranges, beams by azimuth steps."""

from __future__ import annotations

import io
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact.arrays import one_line, read_array
from urbantwin.artefact.document import read_bytes
from urbantwin.errors import InputError
from urbantwin.fidelity.background_estimation import described
from urbantwin.fidelity.beam_assignment import BeamsOf
from urbantwin.io.matlab import read_matlab
from urbantwin.lidar.background import MeasuredBackground
from urbantwin.lidar.background_file import save_backgrounds

__all__ = ["is_matrix", "measure_matrix"]

_ENDINGS = (".mat", ".npy", ".csv", ".txt")
#: Maximum elevation difference of a channel and its row, degrees.
_SAME_DEG = 0.5


def is_matrix(path: Path) -> bool:
    """Return whether a path is a matrix file."""
    return path.is_file() and path.suffix.lower() in _ENDINGS


def measure_matrix(
    real: Path, beams: BeamsOf, out: Path, *, elevations: Path | None = None
) -> dict[str, Any]:
    """Convert a matrix of background ranges to a measured background and write it.

    A row is a beam, a column an azimuth step, from 0 counter-clockwise from the sensor's x axis. 0
    is no range. Noise, dropout and intensity are not part of a matrix and are left to the sensor
    model.

    Args:
        real: MATLAB's ``.mat`` up to version 7, ``.npy``, or numbers in lines.
        beams: the sensor.
        out: the ``.npz`` to write.
        elevations: a file with one elevation per row, radians or degrees; if not given, rows are
            the sensor's channels.

    Returns:
        The summary of `background_estimation.described`.

    Raises:
        InputError: a file is not such a matrix, or its rows do not match the sensor's channels.
    """
    ranges = _read(real)
    if ranges.ndim != 2 or min(ranges.shape) < 2:
        raise InputError("is not a matrix", file=real, expected="ranges, beams by steps of azimuth")
    ranges = np.where(np.isfinite(ranges) & (ranges > 0), ranges, 0.0)
    up = beams.sensor.elevation_deg
    if elevations is not None:
        up = _read(elevations).ravel()
        if np.abs(up).max(initial=0) <= np.pi / 2:  # radians: degrees would be larger
            up = np.degrees(up)
    if len(up) != len(ranges):
        raise InputError(
            f"has {len(ranges)} rows for {len(up)} elevations",
            file=real,
            expected="a matrix with as many, or a folder of frames",
        )
    apart = np.abs(beams.sensor.elevation_deg[:, None] - up[None, :])
    row = apart.argmin(axis=1)
    if len(np.unique(row)) < len(row) or apart.min(axis=1).max() > _SAME_DEG:
        raise InputError(
            f"its rows are not the channels of {beams.sensor.name}",
            file=real if elevations is None else elevations,
            expected=f"{len(row)} elevations like the sensor's",
        )
    found = _on_beams(ranges[row], beams)
    save_backgrounds(out, [found])
    return {"sensors": [described(found)]}


def _on_beams(ranges: NDArray[np.float64], beams: BeamsOf) -> MeasuredBackground:
    """Return the background of a matrix whose rows are the channels."""
    channels, steps = ranges.shape
    aim = beams.directions
    step = np.floor(np.degrees(np.arctan2(aim[..., 1], aim[..., 0])) % 360 * steps / 360)
    seen = ranges[np.arange(channels)[:, None], step.astype(np.int64) % steps]
    image = seen[None].astype(np.float32)
    unknown = np.where(image > 0, np.float32(np.nan), np.float32(0))
    return MeasuredBackground(
        image,
        unknown,
        unknown,
        np.full_like(image, np.nan),
        np.zeros(seen.shape, np.int32),
        beams.sensor.name,
        beams.turns_per_second,
        beams.name,
    )


def _read(path: Path) -> NDArray[np.float64]:
    """Return the numbers of a file; the largest of several arrays in a ``.mat``."""
    expected = ".mat (up to version 7), .npy, or numbers in lines"
    kind = path.suffix.lower()
    if kind == ".npy":
        return _numbers(read_array(path, expected), path, expected)
    if kind == ".mat":
        tables = read_matlab(path, expected)
        return _numbers(max(tables.values(), key=np.size), path, expected)
    text = read_bytes(path, expected)
    comma = "," if b"," in text[:10_000] else None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # files without numbers fail below
            return np.loadtxt(io.BytesIO(text), np.float64, delimiter=comma)
    except (ValueError, OverflowError, MemoryError) as error:
        problem = f"is not readable ({one_line(error)})"
        raise InputError(problem, file=path, expected=expected) from None


def _numbers(array: NDArray[Any], path: Path, expected: str) -> NDArray[np.float64]:
    if array.dtype.kind not in "fiu":
        raise InputError(f"holds {array.dtype}", file=path, expected=expected)
    return array.astype(np.float64)
