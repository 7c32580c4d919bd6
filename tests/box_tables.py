"""Small tables of a data set: rows that say what a test is about, all else filled in."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from urbantwin.dataset.reading.columns import TABLES, arrow_schema


def write_table(file: Path, rows: Iterable[Mapping[str, Any]]) -> None:
    """Write a table of a data set, of the columns that its name says."""
    columns = TABLES[file.name]
    usual = {"string": "car", "float64": 0.0, "int32": 0}
    filled = [{**{name: usual.get(kind) for name, kind in columns.items()}, **row} for row in rows]
    pq.write_table(pa.Table.from_pylist(filled, schema=arrow_schema(columns)), file)
