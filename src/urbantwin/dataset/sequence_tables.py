"""Tables of a dataset's actors and sensors over all frames."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from urbantwin.dataset.pose_table import frame_poses, write_poses
from urbantwin.dataset.reading.columns import (
    LANES,
    LANES_FILE,
    PLACE,
    TRAJECTORIES_FILE,
    arrow_schema,
)
from urbantwin.dataset.reading.tables import read_table
from urbantwin.dataset.tracklets import write_tracklets
from urbantwin.dataset.trajectories import write_trajectories

if TYPE_CHECKING:
    from urbantwin.roads.network import RoadNetwork
    from urbantwin.traffic.motion import Motion
    from urbantwin.twin import Twin

__all__ = ["write_sequence_tables"]


def write_lanes(path: Path, roads: RoadNetwork) -> None:
    """Write ``lanes.parquet``, one row per lane by id, which ``trajectories.parquet`` refers to.

    ``x``, ``y`` and ``z`` are lists: the centre line from start to end, site frame, metres;
    ``successors`` are ids of the following lanes, ``allowed`` the classes that may use it.

    Args:
        path: the file.
        roads: the twin's network.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    rows: list[dict[str, Any]] = [
        {
            **{name: getattr(lane, name) for name in LANES if name not in PLACE},
            **dict(zip(PLACE, lane.centre.T.tolist(), strict=True)),
        }
        for lane in sorted(roads.lanes, key=lambda item: item.id)
    ]
    table = pa.Table.from_pylist(rows, schema=arrow_schema(LANES))
    pq.write_table(table, path, compression="zstd")


def write_sequence_tables(
    folder: Path,
    manifest: Mapping[str, Any],
    source: Path,
    motion: Motion | None,
    twin: Twin | None = None,
) -> None:
    """Write the tables of `columns.SEQUENCE_TABLES`.

    Without a motion there are no trajectories, and without a twin with streets no lanes.

    Args:
        folder: output folder.
        manifest: ``dataset.json``, or its entries of frames and rig.
        source: folder of the dataset, for its boxes and sweeps.
        motion: the recorded motion.
        twin: the twin of the motion.

    Raises:
        InputError: the boxes or the sweeps are damaged.
    """
    boxes = read_table(source / "boxes.parquet")
    sweeps = read_table(source / "sweeps.parquet")
    write_poses(folder / "poses.parquet", manifest, sweeps)
    write_tracklets(folder, boxes, frame_poses(manifest))
    if twin is not None and "roads.json" in twin.manifest["files"]:
        write_lanes(folder / LANES_FILE, twin.roads)
    if motion is None:
        return
    times = [float(entry["time_s"]) for entry in manifest["frames"]]
    write_trajectories(
        folder / TRAJECTORIES_FILE,
        motion,
        set(boxes["track"].to_pylist()),
        (times[0], times[-1]),
        boxes=manifest["rig"].get("boxes", "track"),
        seed=manifest["seeds"]["record"],
        carrier=manifest["rig"].get("carrier"),
    )
