"""The tables of a dataset, read again: which columns they must have, and of what kind."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact.tables import columns_of, read_parquet
from urbantwin.errors import InputError

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["frames_of", "read_table"]

_POSE = ("x", "y", "z", "yaw", "pitch", "roll")
_BOX = ("x", "y", "z", "length", "width", "height", "yaw")
_VELOCITY = ("vx", "vy", "vz")

#: By file: the columns that every version wrote, and of what kind they are (`columns_of`). What a
#: version added since may be missing.
_FORMS: dict[str, Mapping[str, str]] = {
    "boxes.parquet": {
        **dict.fromkeys(("frame", "class"), "text"),
        **dict.fromkeys(("track", "num_points"), "whole"),
        **dict.fromkeys(("time_s", *_BOX, *_VELOCITY, "observed_s"), "number"),
    },
    "sweeps.parquet": {
        **dict.fromkeys(("frame", "sensor"), "text"),
        "turn": "whole",
        **dict.fromkeys(("start_s", "clock_start_s"), "number"),
        **{f"{kind}_{name}": "number" for kind in ("true", "reported") for name in _POSE},
    },
    "poses.parquet": {
        **dict.fromkeys(("frame", "name"), "text"),
        "turn": "whole",
        "time_s": "number",
        **{f"{kind}_{name}": "number" for kind in ("true", "reported") for name in _POSE},
    },
    "tracks.parquet": {
        **dict.fromkeys(("class", "first_frame", "last_frame"), "text"),
        "track": "whole",
    },
    "tracklets.parquet": {
        **dict.fromkeys(("class", "frame"), "text"),
        **dict.fromkeys(("track", "num_points"), "whole"),
        **dict.fromkeys(("time_s", *_POSE, *_BOX, *_VELOCITY), "number"),
    },
    "lanes.parquet": {
        **dict.fromkeys(("id", "road", "junction", "kind"), "text"),
        **dict.fromkeys(("width", "speed_limit"), "number"),
        "level": "whole",
    },
    "trajectories.parquet": {
        "class": "text",
        "track": "whole",
        **dict.fromkeys(("time_s", *_POSE), "number"),
    },
}
#: What boxes may lack, and may not know of every row.
_SHARES = ("occlusion", "visibility", "truncation")
_TEXTS = ("difficulty", "ignored")
_LISTS = ("x", "y", "z")
#: Nothing in a site, and no time of a motion, is farther from 0.
_FURTHEST = 1e10
_LARGEST_TRACK = 2**31


def frames_of(table: pa.Table) -> tuple[list[str], NDArray[np.int64]]:
    """Return the names of frames in a table, and which of them each row (N,) is of."""
    frames = table["frame"].combine_chunks().dictionary_encode()
    codes = frames.indices.to_numpy(zero_copy_only=False).astype(np.int64)
    return frames.dictionary.to_pylist(), codes


def read_table(path: Path) -> pa.Table:
    """Read a table of a dataset, one of those of `_FORMS`.

    Raises:
        InputError: it is missing or damaged, or a column is missing, of another kind, without a
            value, or beyond everything that can be meant; it is named.
    """
    import pyarrow as pa

    expected = f"{path.name} of a dataset"
    table = read_parquet(path, expected)
    for name, values in columns_of(table, _FORMS[path.name], path, expected).items():
        if values.dtype.kind not in "fi" or not len(values):
            continue
        most = _LARGEST_TRACK if values.dtype.kind == "i" else _FURTHEST
        if np.abs(values).max() > most:
            raise InputError("has a value that is out of bounds", file=path, place=name)
    if path.name == "lanes.parquet":
        for name in _LISTS:
            if name not in table.column_names or not pa.types.is_list(table[name].type):
                raise InputError("is no list", file=path, place=name, expected="a list of metres")
    for name in _SHARES:
        if name in table.column_names and not pa.types.is_floating(table[name].type):
            raise InputError(f"holds {table[name].type}", file=path, place=name, expected="number")
    for name in _TEXTS:
        if name in table.column_names and not pa.types.is_string(table[name].type):
            raise InputError(f"holds {table[name].type}", file=path, place=name, expected="text")
    return table
