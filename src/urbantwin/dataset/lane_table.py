"""``lanes.parquet``: the lanes that a dataset's actors were driven on, for motion forecasting."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from urbantwin.roads.network import RoadNetwork

__all__ = ["LANES", "write_lanes"]

LANES = "lanes.parquet"

#: What of a lane is told as it is (`roads.network.Lane`), and its Arrow type.
_TOLD = {
    **dict.fromkeys(("id", "road", "junction", "kind"), "string"),
    **dict.fromkeys(("width", "speed_limit"), "float64"),
    "level": "int32",
}


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
            **{name: getattr(lane, name) for name in _TOLD},
            "allowed": list(lane.allowed),
            "successors": list(lane.successors),
            **dict(zip(("x", "y", "z"), lane.centre.T.tolist(), strict=True)),
        }
        for lane in sorted(roads.lanes, key=lambda one: one.id)
    ]
    schema = pa.schema(
        [(name, getattr(pa, kind)()) for name, kind in _TOLD.items()]
        + [(name, pa.list_(pa.string())) for name in ("allowed", "successors")]
        + [(name, pa.list_(pa.float64())) for name in ("x", "y", "z")]
    )
    pq.write_table(pa.Table.from_pylist(rows, schema=schema), path, compression="zstd")
