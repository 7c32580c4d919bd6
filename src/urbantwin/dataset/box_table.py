"""``boxes.parquet``: the attributes of boxes that the label files have no room for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from urbantwin.artefact.tables import PARQUET
from urbantwin.dataset.layout import frame_name
from urbantwin.lidar.annotated import truck_of_load

if TYPE_CHECKING:
    from urbantwin.traffic.motion import Motion

__all__ = ["write_boxes"]

#: Columns and Arrow types. Boxes and velocities are in the dataset's frame: metres, radians,
#: metres per second. A box stands where its actor was ``observed_s`` after the frame's time, when
#: the rays met it. ``occlusion`` and ``visibility`` are null for an actor that no ray reaches even
#: when it is alone in the world; of ``difficulty`` and ``ignored`` one is (``docs/labels.md``).
#: ``towed_by`` is the track that it hangs on, null for most.
_COLUMNS = {
    "frame": "string",
    "time_s": "float64",
    "track": "int32",
    "class": "string",
    **dict.fromkeys(("x", "y", "z", "length", "width", "height", "yaw"), "float64"),
    "num_points": "int32",
    "num_points_alone": "int32",
    "occlusion": "float64",
    "visibility": "float64",
    "truncation": "float64",
    "difficulty": "string",
    "ignored": "string",
    "observed_s": "float64",
    **dict.fromkeys(("vx", "vy", "vz"), "float64"),
    "parked": "bool_",
    "towed_by": "int32",
}


def write_boxes(
    path: Path,
    times_s: Mapping[int, float],
    entries: Sequence[Mapping[str, Any]],
    motion: Motion,
) -> None:
    """Write the table.

    Args:
        path: the file.
        times_s: number of each frame -> its time.
        entries: what ``layout.write_frame`` returned for each frame, in the same order.
        motion: whose actors these are: who is parked, and who is towed by whom.
    """
    # Imported here: workers, which start with this package, have no use for it.
    import pyarrow as pa
    import pyarrow.parquet as pq

    from urbantwin.traffic.paths.coupling import towed_by

    parked, pulls = frozenset(motion.parked["track"].to_pylist()), towed_by(motion.rows)
    rows = [
        {
            "frame": frame_name(index),
            "time_s": time_s,
            **box,
            "parked": box["track"] in parked,
            "towed_by": pulls.get(box["track"], _carries(box)),
        }
        for (index, time_s), entry in zip(times_s.items(), entries, strict=True)
        for box in entry["boxes"]
    ]
    schema = pa.schema([(name, getattr(pa, kind)()) for name, kind in _COLUMNS.items()])
    pq.write_table(pa.Table.from_pylist(rows, schema=schema), path, **PARQUET)


def _carries(box: Mapping[str, Any]) -> int | None:
    """Return the track of the truck whose load is in a box."""
    return truck_of_load(box["track"]) if box["class"] == "trailer" else None
