"""The files of one frame, read again: what ``layout.write_frame`` wrote."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact.arrays import read_array
from urbantwin.errors import InputError

__all__ = ["ray_place", "read_labels", "read_rays"]

_RAYS = "a table of rays, one for each point"
#: No sensor has more channels.
_MOST_RINGS = 4096


def read_labels(path: Path, points: int | None = None) -> NDArray[np.uint32]:
    """Return the labels (N,) of a frame's points: class in the low 16 bits, track in the high.

    Args:
        path: the ``.label``.
        points: how many points the frame has; not checked if not given.

    Raises:
        InputError: missing, or not a label for each point.
    """
    expected = "4 bytes for each point" if points is None else f"{4 * points} bytes"
    expected += ", a label for each point" if points is not None else ", its label"
    try:
        size = path.stat().st_size
        whole = size - size % 4 if points is None else 4 * points
        if size != whole:
            place = f"byte {min(size, whole)}"
            raise InputError(f"has {size} bytes", file=path, place=place, expected=expected)
        return np.fromfile(path, "<u4")
    except FileNotFoundError:
        raise InputError("not found", file=path, expected=expected) from None
    except OSError as error:
        why = error.strerror or "unknown"
        raise InputError(f"cannot be read ({why})", file=path, expected=expected) from None


def read_rays(path: Path, points: int | None = None) -> NDArray[np.void]:
    """Return what ``rays/`` says of each point; datasets of older versions lack some fields.

    Args:
        path: the ``.npy``.
        points: how many points the frame has; not checked if not given.

    Raises:
        InputError: missing, or not such a table: whole numbers, and finite times.
    """
    table: NDArray[np.void] = read_array(path, _RAYS)
    if not table.dtype.names or table.ndim != 1 or (points is not None and len(table) != points):
        raise InputError(f"is an array of shape {table.shape}", file=path, expected=_RAYS)
    for name in table.dtype.names:
        kind = table.dtype[name]
        if kind.shape or kind.kind not in ("f" if name == "time" else "ui"):
            raise InputError(f"holds {kind}", file=path, place=name[:40], expected=_RAYS)
        if kind.kind == "f" and not np.isfinite(table[name]).all():
            place = ray_place(path, table, name, int(np.argmin(np.isfinite(table[name]))))
            raise InputError("has a time that is not finite", file=path, place=place)
    if "ring" in table.dtype.names and len(table) and table["ring"].max() >= _MOST_RINGS:
        row = int(np.argmax(table["ring"] >= _MOST_RINGS))
        raise InputError(
            f"has ring {table['ring'][row]}",
            file=path,
            place=ray_place(path, table, "ring", row),
            expected=f"0 to {_MOST_RINGS - 1}",
        )
    return table


def ray_place(path: Path, table: NDArray[np.void], name: str, row: int) -> str:
    """Return the name of a value in a frame's table of rays, and the byte where it begins."""
    fields = table.dtype.fields
    assert fields is not None
    begin = path.stat().st_size - table.nbytes
    return f"{name} of ray {row} (byte {begin + row * table.itemsize + fields[name][1]})"
