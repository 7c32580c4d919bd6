"""Where a damaged file of an artefact is wrong, by its format and by what else says the same."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from urbantwin.artefact.arrays import read_array, read_arrays
from urbantwin.artefact.damaged_bytes import picture_place
from urbantwin.artefact.document import read_json_value
from urbantwin.artefact.tables import read_parquet
from urbantwin.dataset.block_sums import damaged_block
from urbantwin.dataset.box_columns import label_line
from urbantwin.dataset.reading.columns import BOX
from urbantwin.dataset.reading.frame_files import read_labels, read_rays
from urbantwin.dataset.reading.manifest import read_manifest
from urbantwin.errors import InputError

__all__ = ["where_damaged"]

_EXPECTED = "as it was written"


def where_damaged(path: Path) -> str:
    """Return which bytes of a file are wrong and how; empty where nothing tells.

    What is written twice in a dataset (the boxes' labels, the names of frames) is compared; a bit
    that turned in the middle of numbers is told by the checksums of blocks.
    """
    look = _LOOKS.get(path.suffix)
    try:
        return (look(path) if look else None) or damaged_block(path)
    except InputError as error:
        if error.file != str(path):  # what it is compared with is damaged, too
            return ""
        return f"{error.place}: {error.problem}" if error.place else error.problem
    except OSError as error:
        return f"cannot be read ({error.strerror})"


def _read_by(read: Callable[[Path, str], object]) -> Callable[[Path], None]:
    """Return what reads a file for the error that comes of it alone."""

    def look(path: Path) -> None:
        read(path, _EXPECTED)

    return look


def _array(path: Path) -> None:
    if path.parent.name == "rays":
        read_rays(path)
    else:
        read_array(path, _EXPECTED)


def _labels(path: Path) -> None:
    """Compare the labels of points with how many points there are."""
    points = path.parent.parent / "points" / f"{path.stem}.npy"
    read_labels(path, len(read_array(points, _EXPECTED)))


def _text(path: Path) -> str | None:
    if path.parent.name == "labels":
        return _first_difference(path, _written_labels(path))
    if path.parent.name == "ImageSets":
        return _foreign_frame(path)
    return None


def _written_labels(path: Path) -> bytes:
    """Return what the labels of a frame are, by the dataset's table of boxes."""
    table = read_parquet(path.parent.parent / "boxes.parquet", _EXPECTED)
    rows = [row for row in table.to_pylist() if row.get("frame") == path.stem]
    try:
        lines = [
            label_line(np.array([row[name] for name in BOX], np.float64), row["class"])
            for row in rows
        ]
    except (KeyError, TypeError, ValueError):
        raise InputError("has other columns", file=path.parent.parent / "boxes.parquet") from None
    return "".join(lines).encode()


def _first_difference(path: Path, written: bytes) -> str | None:
    found = path.read_bytes()
    if found == written:
        return None
    pairs = enumerate(zip(found, written, strict=False))
    byte = next((k for k, (one, other) in pairs if one != other), min(len(found), len(written)))
    line = written.count(b"\n", 0, byte) + 1
    return f"line {line} (byte {byte}): is not what the boxes say"


def _foreign_frame(path: Path) -> str | None:
    """Return the first line of a list of frames that names none of the dataset."""
    manifest = read_manifest(path.parent.parent)
    names = {str(one["name"]).encode() for one in manifest.get("frames", [])}
    byte = 0
    for number, line in enumerate(path.read_bytes().split(b"\n"), 1):
        if line not in names and line:
            return f"line {number} (byte {byte}): names no frame of the dataset"
        byte += len(line) + 1
    return None


def _picture(path: Path) -> str | None:
    place = picture_place(path)
    return place and f"{place}: its own checksum is another"


_LOOKS: dict[str, Callable[[Path], str | None]] = {
    ".npy": _array,
    ".npz": _read_by(read_arrays),
    ".parquet": _read_by(read_parquet),
    **dict.fromkeys((".json", ".geojson"), _read_by(read_json_value)),
    ".label": _labels,
    ".txt": _text,
    ".png": _picture,
}
