"""``split.json``: the part of each dataset in a split by scenario."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from urbantwin.artefact import read_json, replaced_file, write_json
from urbantwin.artefact.manifest import Part, validated
from urbantwin.dataset.description import parts_of
from urbantwin.dataset.reading.manifest import read_manifest
from urbantwin.errors import InputError

__all__ = [
    "SplitDocument",
    "is_split_document",
    "read_split_document",
    "says_split",
    "write_split_document",
]

_EXPECTED = "a split of urbantwin dataset split"


class _Row(Part):
    path: Annotated[str, Field(min_length=1, max_length=4096, pattern=r"^[^\x00]+$")]
    part: Literal["train", "val", "test"]
    motion_sha256: str | None = None
    kept: list[str] | None = None


class _Document(Part):
    kind: Literal["split"]
    datasets: Annotated[list[_Row], Field(min_length=1, max_length=100_000)]


@dataclass(frozen=True)
class SplitDocument:
    """A split of datasets by scenario.

    Attributes:
        file: where it was read.
        rows: path of each dataset (of sensors that are not fused, of each one's), its part, and the
            names of frames that were kept or ``None``.
    """

    file: Path
    rows: tuple[tuple[Path, str, tuple[str, ...] | None], ...]

    def datasets(self, part: str) -> dict[Path, tuple[str, ...] | None]:
        """Return the datasets of a part, and which of their frames, all for ``None``.

        Args:
            part: ``train``, ``val``, ``test`` or ``all``.

        Raises:
            InputError: it has none.
        """
        found = {path: kept for path, mine, kept in self.rows if part in ("all", mine)}
        if not found:
            raise InputError(f"has no dataset for {part}", file=self.file, expected=_EXPECTED)
        return found


def is_split_document(path: Path) -> bool:
    """Return whether a path is meant to be one."""
    return path.suffix.lower() == ".json" and path.is_file()


def says_split(path: Path) -> bool:
    """Return whether a file says that it is one."""
    if not is_split_document(path):
        return False
    try:
        return read_json(path, kind="split").get("kind") == "split"
    except InputError:
        return False


def read_split_document(file: Path) -> SplitDocument:
    """Read a document.

    Raises:
        InputError: it is damaged, names a dataset that is not there, or one that was recorded anew
            from another motion since.
    """
    document = validated(read_json(file, kind="split"), _Document, file=file, expected=_EXPECTED)
    rows = []
    for number, row in enumerate(document.datasets):
        folder = file.parent / row.path
        place = f"datasets[{number}].path"
        # Of a name that is too long for any file this says no, and `Path` raises.
        if not os.path.isfile(folder / "dataset.json"):  # noqa: PTH113
            raise InputError(
                f"names {row.path[:80]}, which is no dataset", file=file, place=place,
                expected="a dataset at this place, relative to the file",
            )  # fmt: skip
        now = read_manifest(folder).get("motion_sha256")
        if row.motion_sha256 is not None and now != row.motion_sha256:
            raise InputError(
                f"was made when {row.path[:80]} showed another motion", file=file, place=place,
                expected="`urbantwin dataset split` once more",
            )  # fmt: skip
        names = None if row.kept is None else tuple(row.kept)
        rows += [(part, row.part, names) for part in parts_of(folder)]
    return SplitDocument(file, tuple(rows))


def write_split_document(file: Path, told: Mapping[str, Any]) -> None:
    """Write a document; paths of datasets become relative to it.

    Raises:
        InputError: it cannot be written there.
    """
    folder = file.resolve().parent
    rows = [
        {**row, "path": Path(os.path.relpath(Path(row["path"]).resolve(), folder)).as_posix()}
        for row in told["datasets"]
    ]
    with replaced_file(file, kind="split") as passing:
        write_json(passing, {**told, "datasets": rows})
