"""``sweeps.parquet``: time, pose and loss of every turn of every sensor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from urbantwin.artefact.tables import PARQUET
from urbantwin.dataset.layout import frame_name
from urbantwin.dataset.reading.columns import POSE, SWEEPS, arrow_schema
from urbantwin.geometry import ypr_from_rotation
from urbantwin.lidar.actor_path import ActorPath
from urbantwin.lidar.rig import Rig
from urbantwin.lidar.timing import turns_of

__all__ = ["sweep_rows", "write_sweeps"]


def sweep_rows(
    rig: Rig, index: int, seed: int, carrier: ActorPath | None = None
) -> list[dict[str, Any]]:
    """Return one row per sensor and turn of a frame, for JSON.

    Args:
        rig: the sensors.
        index: number of the frame.
        seed: random seed.
        carrier: path of the actor that carries the rig, if any.
    """
    time_s = index / rig.rate_hz
    rows = []
    for mounted in rig.sensors:
        turns = turns_of(mounted, index, seed)
        if not turns:
            continue
        path = mounted.path(index, seed, carrier)
        begins = np.array([turn.start_s for turn in turns])
        poses = {"true": path.true_poses(begins), "reported": path.reported_poses(begins)}
        for number, turn in enumerate(turns):
            start_s = time_s + turn.start_s
            ahead_s = mounted.clock_offset_s + mounted.clock_drift_ppm * 1e-6 * start_s
            rows.append(
                {
                    "sensor": mounted.name,
                    "turn": turn.number,
                    "start_s": start_s,
                    "stop_s": time_s + turn.stop_s,
                    "clock_start_s": start_s + ahead_s,
                    "arrival_s": time_s + turn.arrival_s,
                    "lost": turn.dropped,
                    **{
                        f"{kind}_{name}": float(value) + 0.0
                        for kind, (rotation, translation) in poses.items()
                        for name, value in zip(
                            POSE,
                            (*translation[number], *ypr_from_rotation(rotation[number])),
                            strict=True,
                        )
                    },
                }
            )
    return rows


def write_sweeps(path: Path, indices: Sequence[int], entries: Sequence[Mapping[str, Any]]) -> None:
    """Write ``sweeps.parquet``.

    Args:
        path: the file.
        indices: number of each frame.
        entries: mark of each frame, in the same order, with its ``sweeps``.
    """
    # Imported here: workers, which start with this package, do not need it.
    import pyarrow as pa
    import pyarrow.parquet as pq

    rows = [
        {"frame": frame_name(index), **row}
        for index, entry in zip(indices, entries, strict=True)
        for row in entry["sweeps"]
    ]
    pq.write_table(pa.Table.from_pylist(rows, schema=arrow_schema(SWEEPS)), path, **PARQUET)
