"""How far boxes are from the sensors that may see them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.dataset.pose_table import frame_poses, pose_of_frame
from urbantwin.dataset.reading.manifest import pose_of_matrix
from urbantwin.dataset.reading.tables import frames_of

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["box_ranges"]


def box_ranges(boxes: pa.Table, sweeps: pa.Table, manifest: Mapping[str, Any]) -> NDArray[Any]:
    """Return how far (B,) the middle of each box is from the nearest sensor, in plan, metres.

    Args:
        boxes: ``boxes.parquet``.
        sweeps: ``sweeps.parquet``: where sensors were that ride.
        manifest: ``dataset.json``: where they stand.
    """
    frames, number = frames_of(boxes)
    middle = np.column_stack([boxes[name].to_numpy() for name in ("x", "y", "z")])
    poses = frame_poses(manifest)
    rides = manifest["dataset_SE3_site"] is None
    standing = np.array(
        [pose_of_matrix(one["site_SE3_sensor"]).translation for one in manifest["rig"]["sensors"]]
    )
    riding: dict[str, list[list[float]]] = {}
    if rides:
        names = ("reported_x", "reported_y", "reported_z")
        places = np.column_stack([sweeps[name].to_numpy() for name in names]).tolist()
        for name, place in zip(sweeps["frame"].to_pylist(), places, strict=True):
            riding.setdefault(name, []).append(place)
    found = np.zeros(len(number))
    order = np.argsort(number, kind="stable")
    cuts = np.flatnonzero(np.diff(number[order])) + 1
    for own in np.split(order, cuts) if len(order) else ():
        name = frames[number[own[0]]]
        pose = pose_of_frame(poses, name)
        eyes = np.array(riding.get(name, [pose.translation.tolist()])) if rides else standing
        away = pose.apply(middle[own])[:, None, :2] - eyes[None, :, :2]
        found[own] = np.linalg.norm(away, axis=2).min(axis=1)
    return found
