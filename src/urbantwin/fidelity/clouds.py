"""Reading clouds: npy, KITTI bin, pcd and ply; a folder of them in the order of its frames."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.fidelity.pcd import read_pcd
from urbantwin.fidelity.ply import read_ply

__all__ = ["FORMATS", "Cloud", "cloud_files", "read_cloud"]

FORMATS = (".npy", ".bin", ".pcd", ".ply")
#: Names that writers give to intensity, in lower case.
_INTENSITY = ("intensity", "scalar_intensity", "i", "reflectivity", "reflectance")
#: Coordinates beyond this are no metres near a sensor, but another layout read wrongly.
_FARTHEST_M = 1e7


@dataclass(frozen=True, eq=False)
class Cloud:
    """One frame of points.

    Attributes:
        points: (N, 3) float64, metres, N >= 1, all finite.
        intensity: (N,) float64 on the file's own scale, or None where the file has none.
        not_finite: points left out because a value was NaN or infinite.
        no_return: points left out because they were exactly (0, 0, 0), which is how several
            drivers write a beam without a return.
    """

    points: NDArray[np.float64]
    intensity: NDArray[np.float64] | None
    not_finite: int = 0
    no_return: int = 0


def cloud_files(folder: Path) -> list[Path]:
    """Return the clouds in a folder, or in ``points/`` of one of our datasets.

    Names are ordered as people count: ``frame_200`` stands before ``frame_1000``.

    Raises:
        InputError: the folder is missing, is no folder, or holds no clouds.
    """
    if not folder.exists():
        raise InputError("not found", file=folder, expected="a folder of clouds")
    if not folder.is_dir():
        raise InputError("is a file", file=folder, expected="a folder of clouds")
    if (folder / "dataset.json").is_file() or (
        (folder / "points").is_dir() and not any(_is_cloud(path) for path in folder.iterdir())
    ):
        folder = folder / "points"
        if not folder.is_dir():
            raise InputError("not found", file=folder, expected="the dataset's points")
    files = sorted((path for path in folder.iterdir() if _is_cloud(path)), key=_counting)
    if not files:
        raise InputError("holds no clouds", file=folder, expected=f"{', '.join(FORMATS)} files")
    return files


def _is_cloud(path: Path) -> bool:
    return path.suffix.lower() in FORMATS and path.is_file() and not path.name.startswith(".")


def _counting(path: Path) -> tuple[list[tuple[int, int, str]], str]:
    """Return a key that sorts numbers in names by value."""
    parts = re.findall(r"\d+|\D+", path.name)
    return [(0, int(part), "") if part.isdigit() else (1, 0, part) for part in parts], path.name


def read_cloud(path: Path, columns: int | None = None) -> Cloud:
    """Read one cloud.

    ``.npy``: (N, 3 or more), x, y, z and, if there is a fourth column, intensity; or a structured
    array with those names. ``.bin``: float32 rows, KITTI's x, y, z, intensity; ``columns`` says
    how many values a row has (nuScenes: 5), otherwise 4, or 3 where only that divides the size.
    ``.pcd`` and ``.ply``: the fields x, y, z and, if there is one, intensity.

    Args:
        path: the file.
        columns: values per row of a ``.bin``; the others say it themselves.

    Raises:
        InputError: not readable as what its name says, truncated, without x, y, z, or without
            a single point.
    """
    if not path.is_file():
        raise InputError("not found", file=path, expected="a cloud")
    kind = path.suffix.lower()
    if kind == ".npy":
        table, intensity = _from_npy(path)
    elif kind == ".bin":
        table, intensity = _from_bin(path, columns)
    elif kind in (".pcd", ".ply"):
        table, intensity = _from_fields(path, read_pcd(path) if kind == ".pcd" else read_ply(path))
    else:
        raise InputError(f"{kind} is unknown", file=path, expected=", ".join(FORMATS))
    return _checked(path, table, intensity)


def _checked(
    path: Path, table: NDArray[np.float64], intensity: NDArray[np.float64] | None
) -> Cloud:
    finite = np.isfinite(table).all(axis=1)
    if intensity is not None:
        finite &= np.isfinite(intensity)
    returned = finite & (table != 0).any(axis=1)
    points = table[returned]
    if not len(points):
        why = "is empty" if not len(table) else f"none of its {len(table)} points has a position"
        raise InputError(why, file=path, expected="at least one point")
    if np.abs(points).max() > _FARTHEST_M:
        raise InputError(
            f"a coordinate is {np.abs(points).max():.3g} m",
            file=path,
            expected="metres in a frame near the sensor (is the number of columns right?)",
        )
    return Cloud(
        points=points,
        intensity=None if intensity is None else intensity[returned],
        not_finite=int((~finite).sum()),
        no_return=int((finite & ~returned).sum()),
    )


def _from_npy(path: Path) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    try:
        array = np.load(path, allow_pickle=False)
    except (ValueError, OSError, EOFError) as error:
        raise InputError(f"is not readable ({error})", file=path, expected="a .npy array") from None
    if array.dtype.names:
        return _from_fields(path, {name: array[name].ravel() for name in array.dtype.names})
    if array.ndim != 2 or array.shape[1] < 3 or array.dtype.kind not in "fiu":
        raise InputError(
            f"is an array of {array.dtype} of shape {array.shape}",
            file=path,
            expected="numbers of shape (N, 3 or more)",
        )
    table = array.astype(np.float64)
    return table[:, :3], table[:, 3] if table.shape[1] > 3 else None


def _from_bin(
    path: Path, columns: int | None
) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    size = path.stat().st_size
    if columns is not None and columns < 3:
        raise InputError(f"{columns} columns", file=path, expected="at least 3: x, y, z")
    width = columns or (3 if size % 16 and not size % 12 else 4)
    if size % (4 * width):
        raise InputError(
            f"is truncated, or has other columns: {size} bytes",
            file=path,
            expected=f"a multiple of {4 * width} (rows of {width} float32)",
        )
    table = np.fromfile(path, "<f4").reshape(-1, width).astype(np.float64)
    return table[:, :3], table[:, 3] if width > 3 else None


def _from_fields(
    path: Path, fields: Mapping[str, NDArray[np.generic]]
) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    named = {name.lower(): values for name, values in fields.items()}
    missing = [name for name in "xyz" if name not in named]
    if missing:
        raise InputError(
            f"has no field {', '.join(missing)}",
            file=path,
            expected=f"x, y, z among {', '.join(fields) or 'its fields'}",
        )
    table = np.column_stack([named[name].astype(np.float64) for name in "xyz"])
    found = [named[name] for name in _INTENSITY if name in named]
    return table, found[0].astype(np.float64) if found else None
