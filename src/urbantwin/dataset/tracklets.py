"""``tracks.parquet`` and ``tracklets.parquet``: tracks, and their boxes frame by frame.

Both are the boxes of a dataset, sorted by track and transformed to the site: a row per track with
its class and size, and a tracklet with its box in every labelled frame, as in KITTI.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.dataset.pose_table import pose_of_frame
from urbantwin.dataset.reading.columns import ANGLES, PLACE, SIZE, VELOCITY
from urbantwin.dataset.reading.tables import frames_of
from urbantwin.geometry import Pose

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["track_table", "tracklet_table", "write_tracklets"]

#: Columns of boxes that a tracklet copies.
_KEPT = ("length", "width", "height", "num_points", "num_points_alone", "occlusion", "visibility",
         "truncation", "difficulty", "ignored")  # fmt: skip


def tracklet_table(boxes: pa.Table, site_SE3_dataset: Mapping[str, Pose]) -> pa.Table:
    """Return a row for every track and labelled frame, by track, then time.

    ``time_s`` is the time of the box, seconds from the motion's start; the box and its velocity
    (``vx``, ``vy``, ``vz``) are in the site frame, and so are ``yaw``, ``pitch`` and ``roll``:
    labelled boxes are upright in the frame of the points, so pitch and roll are not zero if that is
    tilted.

    Args:
        boxes: ``boxes.parquet``.
        site_SE3_dataset: pose of each frame, by name.
    """
    import pyarrow as pa

    names, number = frames_of(boxes)
    poses = [pose_of_frame(site_SE3_dataset, name) for name in names]
    turns = np.array([pose.rotation for pose in poses]).reshape(-1, 3, 3)[number]
    places = np.array([pose.translation for pose in poses]).reshape(-1, 3)[number]
    place = _turned(turns, _columns(boxes, *PLACE)) + places
    velocity = _turned(turns, _columns(boxes, *VELOCITY))
    angles = _angles(turns, boxes["yaw"].to_numpy())
    time_s = boxes["time_s"].to_numpy() + boxes["observed_s"].to_numpy()
    table = pa.table(
        {
            "track": boxes["track"],
            "class": boxes["class"],
            "frame": boxes["frame"],
            "time_s": time_s,
            **dict(zip(PLACE, place.T, strict=True)),
            **dict(zip(ANGLES, angles.T, strict=True)),
            **dict(zip(VELOCITY, velocity.T, strict=True)),
            **{name: boxes[name] for name in _KEPT if name in boxes.column_names},
        }
    )
    order = np.lexsort((time_s, boxes["track"].to_numpy()))
    return table.take(pa.array(order))


def track_table(tracklets: pa.Table, boxes: pa.Table) -> pa.Table:
    """Return a row for every track: class, median size, first and last frame, and visibility.

    ``way_m`` is the distance travelled from its first frame to its last, ``fastest_m_s`` its
    greatest speed in one of them.

    Args:
        tracklets: see `tracklet_table`.
        boxes: ``boxes.parquet``, with parked and towed actors.
    """
    import pyarrow as pa

    track = tracklets["track"].to_numpy()
    tracks, first = np.unique(track, return_index=True)
    last = np.append(first, len(track))[1:] - 1
    points = tracklets["num_points"].to_numpy()
    place = _columns(tracklets, *PLACE)
    step = np.zeros(len(track))
    step[1:] = np.linalg.norm(np.diff(place, axis=0), axis=1)
    step[first] = 0.0
    speed = np.linalg.norm(_columns(tracklets, *VELOCITY), axis=1)
    sizes = _columns(tracklets, *SIZE)
    rows_of_track = [slice(a, b + 1) for a, b in zip(first.tolist(), last.tolist(), strict=True)]
    middle = np.array([np.median(sizes[rows], axis=0) for rows in rows_of_track]).reshape(-1, 3)
    time_s = tracklets["time_s"].to_numpy()
    columns: dict[str, Any] = {
        "track": pa.array(tracks, pa.int32()),
        "class": tracklets["class"].take(pa.array(first)),
        **{name: middle[:, axis] for axis, name in enumerate(SIZE)},
        "first_frame": tracklets["frame"].take(pa.array(first)),
        "last_frame": tracklets["frame"].take(pa.array(last)),
        "first_s": time_s[first],
        "last_s": time_s[last],
        "frames": pa.array(last - first + 1, pa.int32()),
        "frames_with_points": pa.array(_sums(points > 0, first), pa.int32()),
        "points": pa.array(_sums(points, first), pa.int64()),
        "way_m": _sums(step, first),
        "fastest_m_s": np.array([speed[rows].max() for rows in rows_of_track], np.float64),
    }
    _, first_box = np.unique(boxes["track"].to_numpy(), return_index=True)
    for name in ("parked", "towed_by"):
        if name in boxes.column_names:
            columns[name] = boxes[name].take(pa.array(first_box))
    return pa.table(columns)


def write_tracklets(folder: Path, boxes: pa.Table, site_SE3_dataset: Mapping[str, Pose]) -> None:
    """Write both tables into a folder."""
    import pyarrow.parquet as pq

    tracklets = tracklet_table(boxes, site_SE3_dataset)
    pq.write_table(tracklets, folder / "tracklets.parquet", compression="zstd")
    tracks = track_table(tracklets, boxes)
    pq.write_table(tracks, folder / "tracks.parquet", compression="zstd")


def _columns(table: pa.Table, *names: str) -> NDArray[np.float64]:
    return np.column_stack([table[name].to_numpy() for name in names])


def _turned(turns: NDArray[np.float64], places: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.einsum("nij,nj->ni", turns, places))


def _angles(turns: NDArray[np.float64], yaw: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return yaw, pitch and roll (N, 3) in the site of boxes that are upright in their frames."""
    cos, sin, zero = np.cos(yaw), np.sin(yaw), np.zeros(len(yaw))
    ahead = _turned(turns, np.column_stack([cos, sin, zero]))
    left = _turned(turns, np.column_stack([-sin, cos, zero]))
    # `geometry.ypr_from_rotation` of the rotation with columns ahead, left and up.
    angles = [
        np.arctan2(ahead[:, 1], ahead[:, 0]),
        -np.arcsin(np.clip(ahead[:, 2], -1.0, 1.0)),
        np.arctan2(left[:, 2], turns[:, 2, 2]),
    ]
    return np.column_stack(angles) + 0.0


def _sums(values: NDArray[Any], first: NDArray[np.int64]) -> NDArray[Any]:
    """Return the sum of the values of each track, whose rows begin at ``first``."""
    return np.add.reduceat(values, first) if len(first) else values[:0]
