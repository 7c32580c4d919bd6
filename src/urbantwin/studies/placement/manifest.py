"""What ``placement.json`` must hold for a placement to be opened."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pyarrow as pa

from urbantwin.artefact.manifest import Part, PlainName, validated
from urbantwin.artefact.tables import check_finite, read_parquet
from urbantwin.errors import InputError
from urbantwin.studies.placement.measure import MEASURES

__all__ = ["check_placement", "read_layouts"]


class _Manifest(Part):
    layouts: int
    views_cast: int
    candidates: int
    moments: int
    actors: dict[str, int]
    objectives: list[str]
    front: list[PlainName]


def check_placement(manifest: dict[str, Any], file: Path) -> None:
    """Refuse a manifest that is not a placement's.

    Raises:
        InputError: a field is missing or wrong; the first one is named.
    """
    told = validated(manifest, _Manifest, file=file, expected="a placement's manifest")
    for name in told.objectives:
        if name not in MEASURES:
            raise InputError(
                f"{name!r:.40} is no measure", file=file, place="objectives", expected="measures"
            )


def read_layouts(file: Path) -> pa.Table:
    """Read ``layouts.parquet``.

    Raises:
        InputError: it is missing or damaged, or lacks a column.
    """
    expected = "the layouts of a placement"
    table = read_parquet(file, expected)
    kinds = {"layout": pa.int64(), "front": pa.bool_(), "what": pa.string()}
    for name, kind in (kinds | dict.fromkeys(MEASURES, pa.float64())).items():
        if name not in table.column_names:
            raise InputError("is missing", file=file, place=name, expected=expected)
        if table[name].type != kind:
            raise InputError(f"holds {table[name].type}", file=file, place=name, expected=str(kind))
    check_finite(table, [*kinds, *MEASURES], file)
    return table
