"""A background that somebody else measured: a matrix of ranges, beams by steps of azimuth."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.fidelity.measured_background import described
from urbantwin.fidelity.on_beams import BeamsOf
from urbantwin.lidar.measured import MeasuredBackground
from urbantwin.lidar.measured_file import save_backgrounds

__all__ = ["is_matrix", "measure_matrix"]

_ENDINGS = (".mat", ".npy", ".csv", ".txt")
#: A channel's row is the one whose elevation is nearest, within this, degrees.
_SAME_DEG = 0.5


def is_matrix(path: Path) -> bool:
    """Return whether a path is the file of a matrix."""
    return path.is_file() and path.suffix.lower() in _ENDINGS


def measure_matrix(
    real: Path, beams: BeamsOf, out: Path, *, elevations: Path | None = None
) -> dict[str, Any]:
    """Turn a matrix of background ranges into a measured background and write it.

    A row is a beam, a column a step of azimuth: the first from 0, counter-clockwise from the
    sensor's x axis. 0 is no range. Noise, drop-out and intensity are not in a matrix: they are
    left to the modelled sensor.

    Args:
        real: MATLAB's ``.mat`` up to version 7, ``.npy``, or numbers in lines.
        beams: the sensor.
        out: the ``.npz`` to write.
        elevations: a file of as many elevations as there are rows, radians or degrees; rows are
            the sensor's channels if not given.

    Returns:
        What `measured_background.described` does.

    Raises:
        InputError: a file is none such, or its rows are not the sensor's channels.
    """
    ranges = _read(real)
    if ranges.ndim != 2 or min(ranges.shape) < 2:
        raise InputError("is no matrix", file=real, expected="ranges, beams by steps of azimuth")
    ranges = np.where(np.isfinite(ranges) & (ranges > 0), ranges, 0.0)
    up = beams.sensor.elevation_deg
    if elevations is not None:
        up = _read(elevations).ravel()
        if np.abs(up).max(initial=0) <= np.pi / 2:  # No sensor looks up and down so little.
            up = np.degrees(up)
    if len(up) != len(ranges):
        raise InputError(
            f"has {len(ranges)} rows for {len(up)} elevations", file=real, expected="as many"
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
    """Return what beams see of a matrix whose rows are the channels."""
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
    """Return the numbers of a file; of several arrays in a ``.mat``, the largest."""
    expected = ".mat (up to version 7), .npy, or numbers in lines"
    try:
        if path.suffix.lower() == ".mat":
            from scipy.io import loadmat

            tables = [one for name, one in loadmat(path).items() if not name.startswith("__")]
            return np.asarray(max(tables, key=np.size), np.float64)
        if path.suffix.lower() == ".npy":
            return np.asarray(np.load(path, allow_pickle=False), np.float64)
        comma = "," if "," in path.read_text()[:10_000] else None
        return np.loadtxt(path, np.float64, delimiter=comma)
    except FileNotFoundError:
        raise InputError("not found", file=path, expected=expected) from None
    except (OSError, ValueError, TypeError, NotImplementedError) as error:
        problem = str(error).splitlines()[0] if str(error) else "unknown format"
        raise InputError(f"is not readable ({problem})", file=path, expected=expected) from None
