"""``ImageSets/``: the names of the frames of each part, one per line, as OpenPCDet reads them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from urbantwin.artefact.document import read_bytes
from urbantwin.dataset.split.asked import PARTS
from urbantwin.errors import InputError

__all__ = ["FILES", "frames_of_part", "image_sets", "write_image_sets"]

FOLDER = "ImageSets"
#: Files of a dataset's split, relative to the dataset.
FILES = tuple(f"{FOLDER}/{part}.txt" for part in PARTS)
_EXPECTED = "names of frames, one a line"


def write_image_sets(folder: Path, parts: Mapping[str, Sequence[str]]) -> None:
    """Write the lists of a dataset; a part without frames has an empty file.

    Old files are replaced, not overwritten: hard links to them keep their content.
    """
    (folder / FOLDER).mkdir(exist_ok=True)
    for part in PARTS:
        file = folder / FOLDER / f"{part}.txt"
        file.unlink(missing_ok=True)
        file.write_text("".join(f"{name}\n" for name in parts.get(part, ())), encoding="utf-8")


def image_sets(folder: Path) -> dict[str, list[str]]:
    """Return the names of the frames of every list of a dataset, the known parts first.

    Raises:
        InputError: a list cannot be read.
    """
    files = {path.stem: path for path in sorted((folder / FOLDER).glob("*.txt"))}
    standard = [part for part in PARTS if part in files]
    return {
        name: read_bytes(files[name], _EXPECTED).decode(errors="replace").split()
        for name in (*standard, *(name for name in files if name not in standard))
    }


def frames_of_part(folder: Path, part: str) -> list[str] | None:
    """Return the names of the frames of a part; ``None`` if the dataset has no split.

    A dataset of an earlier version has no test part: it is empty.

    Raises:
        InputError: the list cannot be read.
    """
    existing = [file for file in FILES if (folder / file).is_file()]
    if not existing:
        return None
    file = folder / FOLDER / f"{part}.txt"
    if not file.is_file():
        return []
    try:
        return read_bytes(file, _EXPECTED).decode().split()
    except UnicodeDecodeError:
        raise InputError("is no text", file=file, expected=_EXPECTED) from None
