"""Reading of clouds in any format, and of folders of clouds in frame order."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.io.points import (
    FORMATS,
    is_cloud,
    position_and_intensity,
    read_fields,
)

__all__ = [
    "FORMATS",
    "Cloud",
    "UsablePoints",
    "cloud_files",
    "counting_order",
    "read_cloud",
    "usable_points",
]

#: Larger coordinates are not metres near a sensor but a layout read wrongly.
_FARTHEST_M = 1e7


@dataclass(frozen=True, eq=False)
class Cloud:
    """One frame of points.

    Attributes:
        points: (N, 3) float64, metres, N >= 1, all finite.
        intensity: (N,) float64 on the file's own scale, or None if the file has none.
        not_finite: number of points left out because a value was NaN or infinite.
        no_return: number of points left out because they were exactly (0, 0, 0), which is how
            several drivers write a beam without a return.
    """

    points: NDArray[np.float64]
    intensity: NDArray[np.float64] | None
    not_finite: int = 0
    no_return: int = 0


def cloud_files(folder: Path) -> list[Path]:
    """Return the clouds in a folder, or in ``points/`` of one of our datasets.

    Numbers in names are sorted by value: ``frame_200`` comes before ``frame_1000``.

    Raises:
        InputError: the folder is missing, is no folder, or holds no clouds.
    """
    if not folder.exists():
        raise InputError("not found", file=folder, expected="a folder of clouds")
    if not folder.is_dir():
        raise InputError("is a file", file=folder, expected="a folder of clouds")
    if (folder / "dataset.json").is_file() or (
        (folder / "points").is_dir() and not any(is_cloud(path) for path in folder.iterdir())
    ):
        folder = folder / "points"
        if not folder.is_dir():
            raise InputError("not found", file=folder, expected="the dataset's points")
    files = sorted((path for path in folder.iterdir() if is_cloud(path)), key=counting_order)
    if not files:
        raise InputError("holds no clouds", file=folder, expected=f"{', '.join(FORMATS)} files")
    return files


def counting_order(path: Path) -> tuple[list[tuple[int, int, str]], str]:
    """Return a key that sorts paths by name, with numbers by value."""
    parts = re.findall(r"\d+|\D+", path.name)
    return [(0, int(part), "") if part.isdigit() else (1, 0, part) for part in parts], path.name


def read_cloud(path: Path, columns: int | None = None) -> Cloud:
    """Return positions and intensity of one cloud, in any format of `io.points.read_fields`.

    Args:
        path: the file.
        columns: values per row of a ``.bin``; other formats state it.

    Raises:
        InputError: the file does not match its format, is truncated, lacks x, y, z, or has no
            points.
    """
    return _checked(path, *position_and_intensity(path, read_fields(path, columns)))


def _checked(
    path: Path, table: NDArray[np.float64], intensity: NDArray[np.float64] | None
) -> Cloud:
    usable = usable_points(path, table, intensity)
    return Cloud(
        points=table[usable.rows],
        intensity=None if intensity is None else intensity[usable.rows],
        not_finite=usable.not_finite,
        no_return=usable.no_return,
    )


@dataclass(frozen=True, eq=False)
class UsablePoints:
    """Mask (N,) of the usable rows of a table, and the numbers of rejected rows by reason."""

    rows: NDArray[np.bool_]
    not_finite: int
    no_return: int


def usable_points(
    path: Path, table: NDArray[np.float64], intensity: NDArray[np.float64] | None
) -> UsablePoints:
    """Return which rows of (N, 3) coordinates are points.

    Args:
        path: the file, for errors.
        table: x, y, z in metres.
        intensity: (N,) values that must be finite, too.

    Raises:
        InputError: no row is a point, or a coordinate is too large to be metres near a sensor.
    """
    finite = np.isfinite(table).all(axis=1)
    if intensity is not None:
        finite &= np.isfinite(intensity)
    returned = finite & (table != 0).any(axis=1)
    if not returned.any():
        why = "is empty" if not len(table) else f"none of its {len(table)} points has a position"
        raise InputError(why, file=path, expected="at least one point")
    farthest = np.abs(table[returned]).max()
    if farthest > _FARTHEST_M:
        raise InputError(
            f"a coordinate is {farthest:.3g} m",
            file=path,
            expected="metres in a frame near the sensor (are values and columns as its name says?)",
        )
    return UsablePoints(returned, int((~finite).sum()), int((finite & ~returned).sum()))
