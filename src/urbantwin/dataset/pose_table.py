"""``poses.parquet``: where the ego vehicle and every sensor were in each frame, in the site."""

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

#: Name of the row of the vehicle that carries the sensors; of a rig that stands, of its points.
EGO = "ego"


def frame_poses(manifest: Mapping[str, Any]) -> dict[str, Pose]:
    """Return ``site_SE3_dataset`` of every frame of a manifest, by name."""
    whole = manifest["dataset_SE3_site"]
    shared = None if whole is None else pose_of_matrix(whole).inverse()
    found = {}
    for one in manifest["frames"]:
        rows = one.get("dataset_SE3_site")
        pose = shared if rows is None else pose_of_matrix(rows).inverse()
        if pose is not None:
            found[str(one["name"])] = pose
    return found


def pose_of_frame(poses: Mapping[str, Pose], frame: str) -> Pose:
    """Return the pose of a frame that a table names.

    Raises:
        InputError: the manifest has no such frame, or does not say where it is.
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
    """Return the table: of every frame a row of `EGO`, then one for each turn of each sensor.

    The ego's pose is that of the vehicle that carries the rig, by its first sensor's first turn in
    the frame. A rig that stands has no vehicle: there it is the frame of the points.

    Args:
        manifest: ``dataset.json``.
        sweeps: ``sweeps.parquet``.
    """
    import pyarrow as pa

    mounted = {
        str(one["name"]): pose_of_matrix(one["carrier_SE3_sensor"]).inverse()
        for one in manifest["rig"]["sensors"]
        if one.get("carrier_SE3_sensor")
    }
    poses = frame_poses(manifest)
    turns: dict[str, list[dict[str, Any]]] = {}
    for row in sweeps.to_pylist():
        turns.setdefault(str(row["frame"]), []).append(row)
    rows: list[dict[str, Any]] = []
    for one in manifest["frames"]:
        name = str(one["name"])
        own = turns.get(name, [])
        rows += _ego_rows(name, float(one["time_s"]), own, mounted, poses.get(name))
        rows += [
            {
                "frame": name,
                "name": turn["sensor"],
                "turn": turn["turn"],
                "time_s": turn["start_s"],
                **{key: turn[key] for key in POSES if key.startswith(("true_", "reported_"))},
            }
            for turn in own
        ]
    return pa.Table.from_pylist(rows, schema=arrow_schema(POSES))


def write_poses(path: Path, manifest: Mapping[str, Any], sweeps: pa.Table) -> None:
    """Write the table."""
    import pyarrow.parquet as pq

    pq.write_table(pose_table(manifest, sweeps), path, compression="zstd")


def true_and_reported(row: Mapping[str, Any]) -> tuple[Pose, Pose]:
    """Return the true pose of a row of the table or of ``sweeps.parquet``, and the reported one."""
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
    """Return the row of the ego in a frame; none where nothing tells where it was."""
    turn = next((one for one in turns if one["sensor"] in mounted), None)
    if turn is not None:
        sensor_SE3_ego = mounted[str(turn["sensor"])]
        both = [pose @ sensor_SE3_ego for pose in true_and_reported(turn)]
        time_s = float(turn["start_s"])
    elif points is not None:
        both = [points, points]
    else:
        return []
    told: dict[str, Any] = {"frame": frame, "name": EGO, "turn": 0, "time_s": time_s}
    for kind, pose in zip(("true", "reported"), both, strict=True):
        values = (*pose.translation.tolist(), *ypr_from_rotation(pose.rotation))
        told |= {f"{kind}_{n}": v + 0.0 for n, v in zip(POSE, values, strict=True)}
    return [told]
