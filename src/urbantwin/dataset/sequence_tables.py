"""The tables of a dataset that follow its actors and its sensors through all frames."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from urbantwin.dataset.lane_table import write_lanes
from urbantwin.dataset.pose_table import frame_poses, write_poses
from urbantwin.dataset.reading.columns import LANES_FILE, TRAJECTORIES_FILE
from urbantwin.dataset.reading.tables import read_table
from urbantwin.dataset.tracklets import write_tracklets
from urbantwin.dataset.trajectories import write_trajectories

if TYPE_CHECKING:
    from urbantwin.traffic.motion import Motion
    from urbantwin.twin import Twin

__all__ = ["write_sequence_tables"]


def write_sequence_tables(
    folder: Path,
    manifest: Mapping[str, Any],
    source: Path,
    motion: Motion | None,
    twin: Twin | None = None,
) -> None:
    """Write the tables of `columns.SEQUENCE_TABLES`.

    Without a motion there are no trajectories, and without a twin that has streets no lanes.

    Args:
        folder: where they go.
        manifest: ``dataset.json``, or as much of it as says where the frames and the rig are.
        source: the folder of the dataset, for its boxes and its sweeps.
        motion: that was recorded.
        twin: on which it was.

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
    times = [float(one["time_s"]) for one in manifest["frames"]]
    write_trajectories(
        folder / TRAJECTORIES_FILE,
        motion,
        set(boxes["track"].to_pylist()),
        (times[0], times[-1]),
        boxes=manifest["rig"].get("boxes", "track"),
        seed=manifest["seeds"]["record"],
        carrier=manifest["rig"].get("carrier"),
    )
