"""``lanes.parquet``: the lanes that a dataset's actors were driven on, for motion forecasting."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from urbantwin.dataset.reading.columns import LANES, PLACE, arrow_schema

if TYPE_CHECKING:
    from urbantwin.roads.network import RoadNetwork

__all__ = ["write_lanes"]


def write_lanes(path: Path, roads: RoadNetwork) -> None:
    """Write one row for each lane, by its id, which ``trajectories.parquet`` names.

    ``x``, ``y`` and ``z`` are lists: its middle from start to end, site frame, metres;
    ``successors`` are ids of the lanes that follow, ``allowed`` the classes that may use it.

    Args:
        path: the file.
        roads: the twin's.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    rows: list[dict[str, Any]] = [
        {
            **{name: getattr(lane, name) for name in LANES if name not in PLACE},
            **dict(zip(PLACE, lane.centre.T.tolist(), strict=True)),
        }
        for lane in sorted(roads.lanes, key=lambda one: one.id)
    ]
    table = pa.Table.from_pylist(rows, schema=arrow_schema(LANES))
    pq.write_table(table, path, compression="zstd")
