"""``boxes.parquet``: the attributes of boxes that the label files have no room for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from urbantwin.artefact.tables import PARQUET
from urbantwin.dataset.box_columns import UNKNOWN_IS_NAN
from urbantwin.dataset.layout import frame_name
from urbantwin.dataset.reading.columns import BOXES, arrow_schema
from urbantwin.lidar.annotated import truck_of_load

if TYPE_CHECKING:
    from urbantwin.traffic.motion import Motion

__all__ = ["write_boxes"]


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
        entries: what ``layout.write_frame`` returned for each frame, in the same order, with the
            boxes packed.
        motion: whose actors these are: who is parked, and who is towed by whom.
    """
    # Imported here: workers, which start with this package, have no use for it.
    import pyarrow as pa
    import pyarrow.parquet as pq

    from urbantwin.traffic.paths.coupling import towed_by

    parked, pulls = frozenset(motion.parked["track"].to_pylist()), towed_by(motion.rows)
    each = [entry["boxes"] for entry in entries]
    of_frame = np.repeat(np.arange(len(each)), [len(one["track"]) for one in each])
    names = np.array([frame_name(index) for index in times_s], object)
    columns: dict[str, Any] = {
        "frame": names[of_frame],
        "time_s": np.array(list(times_s.values()), np.float64)[of_frame],
    }
    for name in each[0] if each else ():
        columns[name] = np.concatenate([one[name] for one in each])
    track = columns["track"].tolist()
    columns["parked"] = np.array([one in parked for one in track], np.bool_)
    both = zip(track, columns["class"].tolist(), strict=True)
    columns["towed_by"] = [pulls.get(one, _carries(one, kind)) for one, kind in both]
    schema = arrow_schema(BOXES)
    arrays = [
        pa.array(columns[one.name], one.type, from_pandas=one.name in UNKNOWN_IS_NAN)
        for one in schema
    ]
    pq.write_table(pa.table(arrays, schema=schema), path, **PARQUET)


def _carries(track: int, kind: str) -> int | None:
    """Return the track of the truck whose load has a track and a class."""
    return truck_of_load(track) if kind == "trailer" else None
