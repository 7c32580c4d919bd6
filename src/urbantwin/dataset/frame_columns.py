"""Points, labels and rays of a frame as columns of a Parquet file with Zstandard.

Lossless. The encodings were chosen by measurement (``benchmarks/storage.py``): bytes of coordinates
are split, so that signs and exponents are compressed together; intensities have few values; columns
of the turn ascend.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact.tables import read_parquet
from urbantwin.dataset.reading.columns import POINT
from urbantwin.errors import InputError

__all__ = [
    "COLUMNS",
    "DICTIONARY",
    "ENCODINGS",
    "LEVEL",
    "columns_of_frame",
    "parquet_bytes",
    "read_columns",
]

#: NumPy type of each column.
COLUMNS = {
    **dict.fromkeys(POINT, "f4"),
    **dict.fromkeys(("semantic", "instance"), "u2"),
    "sensor": "u1",
    "ring": "u2",
    "column": "u2",
    "time": "f4",
    "echo": "u1",
}
#: Parquet encodings, except of the dictionary-encoded column.
ENCODINGS = {
    **dict.fromkeys(COLUMNS, "BYTE_STREAM_SPLIT"),
    "column": "DELTA_BINARY_PACKED",
    "time": "PLAIN",
}
DICTIONARY = "intensity"
LEVEL = 3


def columns_of_frame(
    points: NDArray[np.float32], labels: NDArray[np.uint32], rays: NDArray[np.void]
) -> dict[str, NDArray[Any]]:
    """Return the columns (N,) of a frame from the arrays of `frame_files.FrameFiles`."""
    return {
        **{name: points[:, k] for k, name in enumerate(POINT)},
        "semantic": (labels & 0xFFFF).astype("u2"),
        "instance": (labels >> 16).astype("u2"),
        **{name: rays[name] for name in rays.dtype.names or ()},
    }


def parquet_bytes(columns: dict[str, NDArray[Any]]) -> bytes:
    """Return the Parquet file of the columns `COLUMNS`."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    arrays = {name: np.ascontiguousarray(columns[name], kind) for name, kind in COLUMNS.items()}
    file = io.BytesIO()
    pq.write_table(
        pa.table(arrays),
        file,
        compression="zstd",
        compression_level=LEVEL,
        use_dictionary=[DICTIONARY],
        column_encoding={k: encoding for k, encoding in ENCODINGS.items() if k != DICTIONARY},
        write_statistics=False,
        row_group_size=1 << 30,
    )
    return file.getvalue()


def read_columns(path: Path, names: Sequence[str], expected: str) -> dict[str, NDArray[Any]]:
    """Read some columns of a file.

    Raises:
        InputError: missing or damaged file, or a column that is missing or of another type.
    """
    import pyarrow as pa

    table = read_parquet(path, expected, columns=names)
    values = {}
    for name in names:
        if name not in table.column_names:
            raise InputError("is missing", file=path, place=name, expected=expected)
        column = table[name]
        if column.type != pa.from_numpy_dtype(np.dtype(COLUMNS[name])) or column.null_count:
            raise InputError(
                f"holds {column.type} with {column.null_count} gaps", file=path, place=name,
                expected=COLUMNS[name],
            )  # fmt: skip
        values[name] = column.to_numpy()
    return values
