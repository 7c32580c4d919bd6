"""Point clouds as arrays by field name: npy, bin, pcd, ply, las, laz."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact.arrays import read_array
from urbantwin.errors import InputError
from urbantwin.io.pcd import read_pcd

__all__ = ["FORMATS", "Fields", "is_cloud", "organised", "position_and_intensity", "read_fields"]

Fields = dict[str, NDArray[np.generic]]

FORMATS = (".npy", ".bin", ".pcd", ".ply", ".las", ".laz")
#: Names of intensity fields, in lower case, the most likely first.
_INTENSITY = ("intensity", "scalar_intensity", "i", "reflectivity", "reflectance", "remission")
#: Suffix of nuScenes' files, whose rows are x, y, z, intensity and ring.
_NUSCENES = ".pcd.bin"
#: Bounds of the rings and columns of an organised LiDAR cloud.
_FEWEST_RINGS, _MOST_RINGS, _MOST_COLUMNS = 4, 256, 8192
#: Maximum number of values in a row of ``.npy``, and the possible numbers in a row of ``.bin``.
_WIDEST = 64
_WIDTHS = (3, 4, 5, 6)
#: Minimum number of values, and minimum share of variance, that determine the width.
_TELLING, _EXPLAINED = 300, 0.05
#: Bounds of intensities and coordinates that are not 0; bits of other fields lie beyond.
_FAINTEST, _BRIGHTEST, _NEAREST_M = 1e-20, 1e12, 1e-30


def is_cloud(path: Path) -> bool:
    """Return whether a path is a point cloud file, by its name."""
    if path.suffix.lower() not in FORMATS or path.name.startswith("."):
        return False
    # A broken link is an unreadable frame, not a missing one.
    return path.is_file() or (path.is_symlink() and not path.is_dir())


def read_fields(path: Path, columns: int | None = None) -> Fields:
    """Return the fields of a point cloud file by their names in lower case.

    ``.npy``: (N, 3 or more), x, y, z and, if there is a fourth column, intensity; or a structured
    array. ``.bin``: float32 rows, KITTI's x, y, z, intensity, and nuScenes' with the ring as the
    fifth if the name ends in ``.pcd.bin``. Their width is ``columns``, otherwise 4, or 3, 5 or 6 if
    the values indicate it (`_width`). ``.pcd``, ``.ply``, ``.las``, ``.laz``: all fields with one
    value per point, coordinates of the last two with scale and offset.

    Args:
        path: the file.
        columns: values per row of a ``.bin``.

    Raises:
        InputError: missing, not of the format of its name, or truncated.
    """
    if not path.is_file():
        raise InputError("not found", file=path, expected="a cloud")
    kind = path.suffix.lower()
    if kind == ".npy":
        return _from_npy(path)
    if kind == ".bin":
        return _from_bin(path, columns)
    if kind == ".pcd":
        named, shape = read_pcd(path)
        return organised({name.lower(): values for name, values in named.items()}, *shape)
    if kind == ".ply":
        named, shape = _from_ply(path)
        return organised({name.lower(): values for name, values in named.items()}, *shape)
    if kind in (".las", ".laz"):
        from urbantwin.io.las import read_las_fields  # with pyproj and shapely

        return read_las_fields(path)
    raise InputError(f"{kind} is unknown", file=path, expected=", ".join(FORMATS))


def position_and_intensity(
    path: Path, fields: Mapping[str, NDArray[np.generic]]
) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    """Return x, y, z (N, 3) and intensity (N,), None without such a field.

    Raises:
        InputError: x, y or z is missing, or a field holds the bits of another one.
    """
    missing = [name for name in "xyz" if name not in fields]
    if missing:
        raise InputError(
            f"has no field {', '.join(missing)}",
            file=path,
            expected=f"x, y, z among {', '.join(fields) or 'its fields'}",
        )
    found = [fields[name] for name in _INTENSITY if name in fields]
    for values in (*(fields[name] for name in "xyz"), *found[:1]):
        if values.dtype.kind not in "fiu":
            raise InputError(f"has values of {values.dtype}", file=path, expected="numbers")
        if values.shape != (len(fields["x"]),):
            raise InputError("has several values of x, y or z in one point", file=path)
    table = np.column_stack([fields[name].astype(np.float64) for name in "xyz"])
    intensity = found[0].astype(np.float64) if found else None
    if intensity is not None and not np.isfinite(intensity).any():
        intensity = None  # an empty field
    _check_sizes(path, table, intensity)
    return table, intensity


def _check_sizes(
    path: Path, table: NDArray[np.float64], intensity: NDArray[np.float64] | None
) -> None:
    """Raise an error for values read at a wrong offset, under a header with consistent sizes.

    Integers read as floats are smaller than any measurement, and floats read from their middle
    larger; single coordinates may be near 0 by chance.
    """
    tiny = ((table != 0) & (np.abs(table) < _NEAREST_M)).mean(axis=0) if len(table) else 0.0
    wrong = ["xyz"[k] for k in np.flatnonzero(np.asarray(tiny) > 0.01)]
    size = 0.0
    if intensity is not None:
        size = float(np.abs(intensity[np.isfinite(intensity)]).max())
        if size > _BRIGHTEST or 0.0 < size < _FAINTEST:
            wrong.append("intensity")
    if wrong:
        raise InputError(
            f"has intensities up to {size:.2g}"
            if wrong[0] == "intensity"
            else f"has {wrong[0]} of less than {_NEAREST_M:g} m",
            file=path,
            expected=f"{wrong[0]} of points (do its header's sizes and order say where it is?)",
        )


def _from_npy(path: Path) -> Fields:
    array = read_array(path, "a .npy array")
    if array.dtype.names:
        named: Fields = {name.lower(): array[name].ravel() for name in array.dtype.names}
        return organised(named, *array.shape) if array.ndim == 2 else named
    image = array.shape[:2] if array.ndim == 3 and _is_turn(*array.shape[:2]) else None
    if image is not None:
        array = array.reshape(-1, array.shape[2])
    if array.ndim != 2 or not 3 <= array.shape[1] <= _WIDEST or array.dtype.kind not in "fiu":
        raise InputError(
            f"is an array of {array.dtype} of shape {array.shape}",
            file=path,
            expected=f"numbers of shape (N, 3 to {_WIDEST})",
        )
    with np.errstate(over="ignore", invalid="ignore"):
        fields = _columns(array.astype(np.float64))
    return fields if image is None else organised(fields, *image)


def _is_turn(height: int, width: int) -> bool:
    """Return whether a shape may be channels by columns, in either order."""
    few, many = sorted((height, width))
    return _FEWEST_RINGS <= few <= _MOST_RINGS and few <= many <= _MOST_COLUMNS


def organised(fields: Fields, height: int, width: int) -> Fields:
    """Add ring and column to the points of an organised LiDAR cloud, row by row.

    Drivers write a row per channel, or per column of the rotation. Existing rings are kept, and
    columns are added if each ring is one row.
    """
    if not _is_turn(height, width) or "column" in fields:
        return fields
    axes = np.divmod(np.arange(height * width), width)
    row, column = axes if height <= width else axes[::-1]
    ring = fields.get("ring", row)
    if "ring" in fields and not _is_one_each(ring, row):
        return fields
    return {**fields, "ring": ring, "column": column}


def _is_one_each(ring: NDArray[np.generic], row: NDArray[np.int64]) -> bool:
    """Return whether each row has its own ring; 0 is allowed for missing returns."""
    if ring.shape != row.shape or ring.dtype.kind not in "fiu":
        return False
    said = np.isfinite(ring) & (ring != 0)
    pairs = np.unique(np.column_stack([row[said], ring[said].astype(np.float64)]), axis=0)
    return len(pairs) == len(np.unique(pairs[:, 0])) == len(np.unique(pairs[:, 1]))


def _from_bin(path: Path, columns: int | None) -> Fields:
    size = path.stat().st_size
    if columns is not None and columns < 3:
        raise InputError(f"{columns} columns", file=path, expected="at least 3: x, y, z")
    named = path.name.lower().endswith(_NUSCENES)
    with np.errstate(invalid="ignore"):  # non-numbers become NaN
        values = np.fromfile(path, "<f4", count=size // 4).astype(np.float64)
    width = columns or (5 if named else _width(values))
    if size % (4 * width):
        raise InputError(
            f"is truncated, or has other columns: {size} bytes",
            file=path,
            expected=f"a multiple of {4 * width} (rows of {width} float32)",
        )
    table = values.reshape(-1, width)
    fields = _columns(table)
    if width == 5 and named:
        fields["ring"] = table[:, 4]
    return fields


def _width(values: NDArray[np.float64]) -> int:
    """Return the number of values per row of a ``.bin``: 4, unless the values indicate another.

    Values of one column are similar in size, those of a row are not (plan, height, intensity). With
    the right width the columns explain much of the variance of the sizes, with another none of it.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        sizes = np.log1p(np.minimum(np.abs(np.nan_to_num(values)), 1e6))
    total = float(sizes.var()) if len(sizes) else 0.0
    if total and len(sizes) >= _TELLING:
        share = {}
        for width in _WIDTHS:
            rows = sizes[: len(sizes) // width * width].reshape(-1, width)
            share[width] = float(rows.mean(axis=0).var()) / total
        best = max(share.values())
        if share[4] >= 0.5 * best > 0.5 * _EXPLAINED:
            return 4
        if best > _EXPLAINED:
            return next(width for width in _WIDTHS if share[width] >= 0.95 * best)
    return 3 if len(sizes) % 4 and not len(sizes) % 3 else 4


def _columns(table: NDArray[np.float64]) -> Fields:
    names = [*"xyz", "intensity"]
    return {name: table[:, k] for k, name in enumerate(names[: len(table.T)])}


def _from_ply(path: Path) -> tuple[dict[str, NDArray[np.float64]], tuple[int, int]]:
    """Return the vertices, and height and width of the organised cloud (1 and N if unorganised).

    PLY has no keyword for it: scanners write ``obj_info num_rows`` and ``num_cols``, others
    comments of ``height`` and ``width``, PCL the viewport of its ``camera``.
    """
    from urbantwin.geometry.ply import read_header, read_tables

    header = read_header(path)
    names = [element.name for element in header.elements]
    last = max(("vertex", "camera"), key=lambda name: names.index(name) if name in names else -1)
    tables = read_tables(path, header, last=last)
    vertex = tables.get("vertex")
    if vertex is None:
        raise InputError("has no element vertex", file=path, expected="a PLY cloud")
    shape = 1, vertex.count
    said = dict(words for text in header.comments if len(words := text.split()) == 2)
    if "camera" in tables:
        view = tables["camera"].columns
        said |= {
            name: str(int(view[of][0]))
            for name, of in (("num_cols", "viewportx"), ("num_rows", "viewporty"))
            if of in view and len(view[of]) and np.isfinite(view[of][0])
        }
    rows = said.get("num_rows", said.get("height", ""))
    columns = said.get("num_cols", said.get("width", ""))
    if rows.isdecimal() and columns.isdecimal() and int(rows) * int(columns) == vertex.count:
        shape = int(rows), int(columns)
    with np.errstate(invalid="ignore"):  # non-numbers become NaN
        fields = {name: values.astype(np.float64) for name, values in vertex.columns.items()}
    return fields, shape
