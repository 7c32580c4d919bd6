"""A folder of detections: ``detections.parquet`` and ``detections.json``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from urbantwin.artefact import check_folder, read_json, replaced_folder, write_json
from urbantwin.artefact.manifest import Part, validated
from urbantwin.artefact.tables import PARQUET, columns_of, read_parquet
from urbantwin.dataset.reading.columns import BOX
from urbantwin.detections.checks import checked
from urbantwin.detections.detections import Detections
from urbantwin.errors import InputError

__all__ = ["KIND", "SCHEMA", "check_detections_folder", "put_detections", "read_detections"]
__all__ += ["write_detections"]

KIND = "detections"
#: Version of the columns and fields; later versions add to them.
SCHEMA = 1
_EXPECTED = "a folder of detections"
_TABLE = "detections.parquet"
_COLUMNS = {
    "frame": "text",
    "class": "text",
    **dict.fromkeys((*BOX, "score"), "number"),
    "track": "whole",
}
#: Optional column of trackers: boxes that were interpolated.
_FILLED = "filled"


class _Manifest(Part):
    kind: Literal["detections"]
    schema_: Literal[1] = Field(alias="schema")
    frames: list[str]
    times_s: list[Annotated[float, Field(ge=-1e12, le=1e12)]] | None = None


def check_detections_folder(target: Path, inputs: Sequence[Path | None] = ()) -> None:
    """Raise an error if an output folder cannot be written, before any work.

    Raises:
        InputError: see `artefact.check_folder`.
    """
    check_folder(target, kind=KIND, inputs=inputs)


def write_detections(
    folder: Path,
    detections: Detections,
    made_by: Mapping[str, Any],
    inputs: Sequence[Path | None] = (),
) -> None:
    """Write detections atomically.

    Args:
        folder: output folder; older detections are replaced.
        detections: the detections; their order is kept.
        made_by: the model or tracker and its settings, as JSON values.
        inputs: paths that the detections were made from; none may be inside ``folder``.

    Raises:
        InputError: the folder cannot be written.
    """
    with replaced_folder(folder, kind=KIND, inputs=inputs) as scratch:
        put_detections(scratch, detections, made_by)


def put_detections(folder: Path, detections: Detections, made_by: Mapping[str, Any]) -> None:
    """Write the files of detections into an existing folder; see `write_detections`."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    names = np.array(detections.frames, dtype=object)
    times = np.full(len(names), np.nan) if detections.time_s is None else detections.time_s
    columns = {
        "frame": pa.array(names[detections.frame].tolist(), pa.string()),
        "time_s": pa.array(times[detections.frame], pa.float64(), from_pandas=True),
        "class": pa.array(detections.class_names, pa.string()),
        **{name: pa.array(detections.box[:, k], pa.float64()) for k, name in enumerate(BOX)},
        "score": pa.array(detections.score, pa.float64()),
        "track": pa.array(detections.track, pa.int64()),
    }
    if detections.filled is not None:
        columns[_FILLED] = pa.array(detections.filled.astype(np.int8), pa.int8())
    told = {
        "kind": KIND,
        "schema": SCHEMA,
        "made_by": dict(made_by),
        "boxes": len(detections),
        "classes": sorted(set(detections.class_names)),
        "frames": list(detections.frames),
        "times_s": None if detections.time_s is None else detections.time_s.tolist(),
    }
    pq.write_table(pa.table(columns), folder / _TABLE, **PARQUET)
    write_json(folder / f"{KIND}.json", told)


def read_detections(path: Path) -> Detections:
    """Return the detections that `write_detections` wrote.

    Raises:
        InputError: a file is missing, damaged, or holds invalid values (see `checks`).
    """
    file = path / f"{KIND}.json"
    told = validated(read_json(file, kind=KIND), _Manifest, file=file, expected=_EXPECTED)
    if told.times_s is not None and len(told.times_s) != len(told.frames):
        raise InputError(
            f"has {len(told.times_s)} times for {len(told.frames)} frames",
            file=file,
            place="times_s",
            expected="one each",
        )
    index = {name: number for number, name in enumerate(told.frames)}
    if len(index) < len(told.frames):
        raise InputError("names a frame twice", file=file, place="frames", expected="each once")
    table = path / _TABLE
    read = read_parquet(table, _EXPECTED, columns=[*_COLUMNS, _FILLED])
    there = _COLUMNS | ({_FILLED: "whole"} if _FILLED in read.column_names else {})
    columns = columns_of(read, there, table, _EXPECTED)
    frames = [index.get(name) for name in columns["frame"]]
    if None in frames:
        name = columns["frame"][frames.index(None)]
        raise InputError(
            f"frame {name!r:.60} is not one of {file.name}", file=table, expected=_EXPECTED
        )
    found = Detections(
        frames=tuple(told.frames),
        frame=np.array(frames, np.int64),
        box=np.column_stack([columns[name] for name in BOX]).reshape(-1, 7),
        class_names=tuple(columns["class"].tolist()),
        score=columns["score"],
        track=columns["track"],
        time_s=None if told.times_s is None else np.array(told.times_s, np.float64),
        filled=columns[_FILLED] != 0 if _FILLED in columns else None,
    )
    return checked(found, table)
