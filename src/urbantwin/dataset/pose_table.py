"""``poses.parquet``: poses of the ego vehicle and every sensor in each frame, in the site."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from urbantwin.dataset.reading.columns import ANGLES, PLACE, POSE, POSES, arrow_schema
from urbantwin.dataset.reading.manifest import pose_of_matrix
from urbantwin.errors import InputError
from urbantwin.geometry import Pose, rotation_from_ypr, ypr_from_rotation

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["EGO", "frame_poses", "pose_of_frame", "pose_table", "true_and_reported", "write_poses"]

#: Name of the row of the vehicle that carries the sensors; for a fixed rig, of its points.
EGO = "ego"


def frame_poses(manifest: Mapping[str, Any]) -> dict[str, Pose]:
    """Return ``site_SE3_dataset`` of every frame of a manifest, by name."""
    whole = manifest["dataset_SE3_site"]
    shared = None if whole is None else pose_of_matrix(whole).inverse()
    poses = {}
    for entry in manifest["frames"]:
        rows = entry.get("dataset_SE3_site")
        pose = shared if rows is None else pose_of_matrix(rows).inverse()
        if pose is not None:
            poses[str(entry["name"])] = pose
    return poses


def pose_of_frame(poses: Mapping[str, Pose], frame: str) -> Pose:
    """Return the pose of a frame named in a table.

    Raises:
        InputError: the manifest lacks the frame, or its pose.
    """
    if frame not in poses:
        raise InputError(
            "does not say where the points of a frame are that boxes.parquet has",
            file="dataset.json",
            place=f"frame {frame[:40]}",
            expected="the frames of its boxes",
        )
    return poses[frame]


def pose_table(manifest: Mapping[str, Any], sweeps: pa.Table) -> pa.Table:
    """Return the table: for every frame a row of `EGO`, then one per turn of each sensor.

    The ego's pose is that of the vehicle that carries the rig, at its first sensor's first turn in
    the frame. For a fixed rig it is the frame of the points.

    Args:
        manifest: ``dataset.json``.
        sweeps: ``sweeps.parquet``.
    """
    import pyarrow as pa

    mounted = {
        str(entry["name"]): pose_of_matrix(entry["carrier_SE3_sensor"]).inverse()
        for entry in manifest["rig"]["sensors"]
        if entry.get("carrier_SE3_sensor")
    }
    poses = frame_poses(manifest)
    turns: dict[str, list[dict[str, Any]]] = {}
    for row in sweeps.to_pylist():
        turns.setdefault(str(row["frame"]), []).append(row)
    rows: list[dict[str, Any]] = []
    for entry in manifest["frames"]:
        name = str(entry["name"])
        turns_of_frame = turns.get(name, [])
        rows += _ego_rows(name, float(entry["time_s"]), turns_of_frame, mounted, poses.get(name))
        rows += [
            {
                "frame": name,
                "name": turn["sensor"],
                "turn": turn["turn"],
                "time_s": turn["start_s"],
                **{key: turn[key] for key in POSES if key.startswith(("true_", "reported_"))},
            }
            for turn in turns_of_frame
        ]
    return pa.Table.from_pylist(rows, schema=arrow_schema(POSES))


def write_poses(path: Path, manifest: Mapping[str, Any], sweeps: pa.Table) -> None:
    """Write the table."""
    import pyarrow.parquet as pq

    pq.write_table(pose_table(manifest, sweeps), path, compression="zstd")


def true_and_reported(row: Mapping[str, Any]) -> tuple[Pose, Pose]:
    """Return the true and the reported pose of a row of the table or of ``sweeps.parquet``."""
    true, reported = (
        Pose(
            rotation_from_ypr(*(row[f"{kind}_{name}"] for name in ANGLES)),
            np.array([row[f"{kind}_{name}"] for name in PLACE], np.float64),
        )
        for kind in ("true", "reported")
    )
    return true, reported


def _ego_rows(
    frame: str,
    time_s: float,
    turns: Sequence[Mapping[str, Any]],
    mounted: Mapping[str, Pose],
    points: Pose | None,
) -> list[dict[str, Any]]:
    """Return the row of the ego in a frame; none if its pose is unknown."""
    turn = next((candidate for candidate in turns if candidate["sensor"] in mounted), None)
    if turn is not None:
        sensor_SE3_ego = mounted[str(turn["sensor"])]
        both = [pose @ sensor_SE3_ego for pose in true_and_reported(turn)]
        time_s = float(turn["start_s"])
    elif points is not None:
        both = [points, points]
    else:
        return []
    row: dict[str, Any] = {"frame": frame, "name": EGO, "turn": 0, "time_s": time_s}
    for kind, pose in zip(("true", "reported"), both, strict=True):
        values = (*pose.translation.tolist(), *ypr_from_rotation(pose.rotation))
        row |= {f"{kind}_{n}": v + 0.0 for n, v in zip(POSE, values, strict=True)}
    return [row]
