"""The index over all datasets of a campaign: ``campaign.json``, a table, and a page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from urbantwin import __version__
from urbantwin.artefact import as_json, kind_of, read_json, sha256_of, write_json
from urbantwin.artefact.manifest import Part, validated
from urbantwin.artefact.tables import write_parquet_and_csv
from urbantwin.campaigns.course import Course
from urbantwin.campaigns.grid_file import AXES
from urbantwin.campaigns.steps import Step
from urbantwin.dataset.description import parts_of
from urbantwin.errors import InputError
from urbantwin.grid import Level
from urbantwin.pages import write_page

__all__ = ["FOLDER", "KIND", "dataset_told", "datasets_of", "index_of", "read_index", "write_index"]

KIND = "campaign"
#: Where it is in the campaign's folder.
FOLDER = "index"
#: So many rows are on the page; the table has all.
_ON_THE_PAGE = 1000
_EXPECTED = "the index of a campaign"
_COUNTED = ("frames", "points", "boxes", "bytes")
_KEPT = (*_COUNTED, "manifest_sha256")
#: The axis of rigs that leave a dataset for each sensor, and the level of those that do not.
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


def dataset_told(folder: Path) -> dict[str, Any]:
    """Return what is noted of a dataset that was made.

    ``frames``, ``points``, ``boxes`` (those with points), ``bytes`` of all its files, and
    ``manifest_sha256``. Of a dataset for each sensor of a rig the same of each, ``sensors``, too.
    """
    parts = parts_of(folder)
    if parts == [folder]:
        return _of_one(folder)
    sensors = {one.name: _of_one(one) for one in parts}
    return {
        **{name: sum(one[name] for one in sensors.values()) for name in _COUNTED},
        "manifest_sha256": sha256_of(folder / "dataset.json"),
        "sensors": sensors,
    }


def _of_one(folder: Path) -> dict[str, Any]:
    file = folder / "dataset.json"
    counts = read_json(file, kind="dataset")["counts"]
    return {
        "frames": counts["frames"],
        "points": counts["points"],
        "boxes": sum(counts["boxes_with_points"].values()),
        "bytes": sum(one.stat().st_size for one in folder.rglob("*") if one.is_file()),
        "manifest_sha256": sha256_of(file),
    }


def index_of(course: Course, sources: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return what ``campaign.json`` holds.

    Args:
        course: at its end.
        sources: inputs of the twins, with licence and attribution.
    """
    asked = course.steps.asked
    rows, failed = [], []
    for step in course.steps.of("dataset"):
        if step.place in course.failed:
            failed.append({"path": step.place, "why": course.failed[step.place]})
        elif course.is_done(step):
            rows += _rows(step, course.journal.row(step.place))
    axes = {one.name: list(one.levels) for one in asked.axes}
    if any(_SENSOR in row["levels"] for row in rows):
        for row in rows:
            row["levels"].setdefault(_SENSOR, _FUSED)
        axes[_SENSOR] = list(dict.fromkeys(row["levels"][_SENSOR] for row in rows))
    return {
        "kind": KIND,
        "schema": 1,
        "urbantwin": __version__,
        "grid": asked.file.name,
        "axes": axes,
        "weather": {one.name: as_json(one.told()) for one in asked.weather},
        "storage": asked.storage,
        "inputs": list(sources),
        "cells": course.totals["dataset"],
        "counts": {name: sum(row[name] for row in rows) for name in _COUNTED},
        "datasets": rows,
        "failed": failed,
        "warnings": [],
    }


def _rows(step: Step, told: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return a row of each dataset of a cell: one, or one for each sensor of its rig."""
    levels = {axis: step.cell[axis] for axis in AXES}
    sensors = told.get("sensors")
    if sensors is None:
        return [{"path": step.place, "levels": levels, **{name: told[name] for name in _KEPT}}]
    return [
        {
            "path": f"{step.place}/{name}",
            "levels": {**levels, _SENSOR: name},
            **{one: own[one] for one in _KEPT},
        }
        for name, own in sensors.items()
    ]


def write_index(folder: Path, index: Mapping[str, Any], picture: Path | None = None) -> None:
    """Write ``campaign.json``, ``cells.parquet`` and ``.csv``, and the page ``campaign.html``."""
    write_json(folder / f"{KIND}.json", index)
    rows = index["datasets"]
    if rows:
        import pyarrow as pa

        flat = [
            {"path": row["path"], **row["levels"], **{k: v for k, v in row.items() if k in _KEPT}}
            for row in rows
        ]
        write_parquet_and_csv(folder / "cells", pa.Table.from_pylist(flat))
    write_page(
        folder / f"{KIND}.html",
        "campaigns/index.html.j2",
        index=index,
        drawn=picture,
        most=_ON_THE_PAGE,
    )


def read_index(folder: Path) -> dict[str, Any]:
    """Read ``campaign.json`` of a campaign's folder, or of the index in it.

    Raises:
        InputError: it is none, or damaged.
    """
    file = folder / f"{KIND}.json"
    if not file.is_file():
        file = folder / FOLDER / f"{KIND}.json"
    told = read_json(file, kind=KIND)
    checked = validated(told, _Index, file=file, expected=_EXPECTED)
    for number, row in enumerate(checked.datasets):
        path = Path(row.path)
        if path.is_absolute() or ".." in path.parts:
            raise InputError(
                "leaves the campaign's folder", file=file, place=f"datasets[{number}].path",
                expected="a folder in it",
            )  # fmt: skip
    return told


def datasets_of(folder: Path) -> list[Path] | None:
    """Return the folders of a campaign's datasets; ``None`` of a folder that is no campaign.

    Raises:
        InputError: its index is damaged.
    """
    if kind_of(folder / FOLDER) != KIND:
        return None
    return [folder / row["path"] for row in read_index(folder)["datasets"]]
