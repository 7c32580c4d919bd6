"""Index of all datasets of a campaign: ``campaign.json``, a table, and a page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from urbantwin import __version__
from urbantwin.artefact import as_json, kind_of, read_json, sha256_of, write_json
from urbantwin.artefact.manifest import Part, validated
from urbantwin.artefact.tables import write_parquet_and_csv
from urbantwin.dataset.description import parts_of
from urbantwin.errors import InputError
from urbantwin.experiments.campaign.file import AXES, CampaignFile
from urbantwin.experiments.course import Course
from urbantwin.experiments.grid import Level
from urbantwin.pages import write_page

__all__ = [
    "INDEX",
    "KIND",
    "dataset_counts",
    "datasets_of",
    "index_of",
    "read_index",
    "write_index",
]

KIND = "campaign"
#: Folder of the index in the campaign's.
INDEX = "index"
#: Most rows on the page; the table has all.
_PAGE_ROWS = 1000
_COUNTED = ("frames", "points", "boxes", "bytes")
_NOTED = (*_COUNTED, "manifest_sha256")
#: The axis of rigs that leave a dataset for each sensor, and its level for other rigs.
_SENSOR, _FUSED = "sensor", "fused"


class _Row(Part):
    path: Annotated[str, Field(min_length=1, max_length=4096, pattern=r"^[^\x00]+$")]
    levels: dict[str, Level]
    frames: int
    manifest_sha256: str


class _Failed(Part):
    path: str
    why: str


class _Counts(Part):
    frames: int
    points: int
    boxes: int
    bytes: int


class _Index(Part):
    kind: Literal["campaign"]
    cells: int
    axes: dict[str, list[Level]]
    counts: _Counts
    datasets: Annotated[list[_Row], Field(max_length=100_000)]
    failed: list[_Failed]


def dataset_counts(folder: Path) -> dict[str, Any]:
    """Return the journal's entry of a dataset.

    ``frames``, ``points``, ``boxes`` (those with points), ``bytes`` of all its files, and
    ``manifest_sha256``; for a dataset per sensor also those of each sensor, ``sensors``.
    """
    sensors = {part.name: _counts(part) for part in parts_of(folder) if part != folder}
    if not sensors:
        return _counts(folder)
    return {
        **{name: sum(one[name] for one in sensors.values()) for name in _COUNTED},
        "manifest_sha256": sha256_of(folder / "dataset.json"),
        "sensors": sensors,
    }


def _counts(folder: Path) -> dict[str, Any]:
    file = folder / "dataset.json"
    counts = read_json(file, kind="dataset")["counts"]
    return {
        "frames": counts["frames"],
        "points": counts["points"],
        "boxes": sum(counts["boxes_with_points"].values()),
        "bytes": sum(one.stat().st_size for one in folder.rglob("*") if one.is_file()),
        "manifest_sha256": sha256_of(file),
    }


def index_of(
    file: CampaignFile, course: Course, sources: Sequence[Mapping[str, Any]]
) -> dict[str, Any]:
    """Return the content of ``campaign.json``.

    Args:
        file: the campaign's file.
        course: the finished course.
        sources: inputs of the twins, with licence and attribution.
    """
    rows, failed = [], []
    for step in course.of("dataset"):
        if step.place in course.failed:
            failed.append({"path": step.place, "why": course.failed[step.place]})
        elif course.state[step.place] == "done":
            levels = {axis: step.cell[axis] for axis in AXES}
            notes = course.journal.row(step.place)
            parts = {step.place: (levels, notes)}
            if "sensors" in notes:
                parts = {
                    f"{step.place}/{name}": ({**levels, _SENSOR: name}, its)
                    for name, its in notes["sensors"].items()
                }
            rows += [
                {"path": path, "levels": its, **{name: row[name] for name in _NOTED}}
                for path, (its, row) in parts.items()
            ]
    axes = {axis.name: list(axis.levels) for axis in file.axes}
    if any(_SENSOR in row["levels"] for row in rows):
        for row in rows:
            row["levels"].setdefault(_SENSOR, _FUSED)
        axes[_SENSOR] = list(dict.fromkeys(row["levels"][_SENSOR] for row in rows))
    return {
        "kind": KIND,
        "schema": 1,
        "urbantwin": __version__,
        "grid": file.file.name,
        "axes": axes,
        "weather": {one.name: as_json(one.changed()) for one in file.weather},
        "storage": file.storage,
        "inputs": list(sources),
        "cells": len(course.of("dataset")),
        "counts": {name: sum(row[name] for row in rows) for name in _COUNTED},
        "datasets": rows,
        "failed": failed,
        "warnings": [],
    }


def write_index(folder: Path, index: Mapping[str, Any], picture: Path | None = None) -> None:
    """Write ``campaign.json``, ``cells.parquet`` and ``.csv``, and the page ``campaign.html``."""
    write_json(folder / f"{KIND}.json", index)
    if index["datasets"]:
        import pyarrow as pa

        flat = [
            {"path": row["path"], **row["levels"], **{k: v for k, v in row.items() if k in _NOTED}}
            for row in index["datasets"]
        ]
        write_parquet_and_csv(folder / "cells", pa.Table.from_pylist(flat))
    page = "experiments/campaign/index.html.j2"
    write_page(folder / f"{KIND}.html", page, index=index, drawn=picture, most=_PAGE_ROWS)


def read_index(folder: Path) -> dict[str, Any]:
    """Read ``campaign.json`` of a campaign's folder, or of the index in it.

    Raises:
        InputError: it is none, or damaged.
    """
    file = folder / f"{KIND}.json"
    if not file.is_file():
        file = folder / INDEX / f"{KIND}.json"
    index = read_json(file, kind=KIND)
    checked = validated(index, _Index, file=file, expected="the index of a campaign")
    for number, row in enumerate(checked.datasets):
        path = Path(row.path)
        if path.is_absolute() or ".." in path.parts:
            raise InputError(
                "leaves the campaign's folder", file=file, place=f"datasets[{number}].path",
                expected="a folder in it",
            )  # fmt: skip
    return index


def datasets_of(folder: Path) -> list[Path] | None:
    """Return the folders of a campaign's datasets; ``None`` if the folder is not a campaign.

    Raises:
        InputError: its index is damaged.
    """
    if kind_of(folder / INDEX) != KIND:
        return None
    return [folder / row["path"] for row in read_index(folder)["datasets"]]
