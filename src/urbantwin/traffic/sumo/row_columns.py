"""The rows written by SUMO's process, as columns."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["row_columns"]

#: Number of rows read at a time, so that the table is not in memory twice.
_ROWS_READ = 1 << 17


def row_columns(path: Path) -> dict[str, NDArray[Any]]:
    """Read the columns of a table (NPY) in parts; x and y are joined as ``front`` (N, 2)."""
    with path.open("rb") as file:
        np.lib.format.read_magic(file)
        (count,), _, kinds = np.lib.format.read_array_header_1_0(file)
        names = kinds.names or ()
        columns = {name: np.empty(count, kinds[name]) for name in names if name not in "xy"}
        columns["front"] = np.empty((count, 2))
        for first in range(0, count, _ROWS_READ):
            rows = np.fromfile(file, kinds, min(_ROWS_READ, count - first))
            part = slice(first, first + len(rows))
            for name in names:
                if name in "xy":
                    columns["front"][part, "xy".index(name)] = rows[name]
                else:
                    columns[name][part] = rows[name]
    return columns
