"""Rows of boxes and matrices of poses, as `urbantwin export` writes them beside frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from urbantwin.artefact.document import json_value
from urbantwin.dataset.reading.columns import BOX, VELOCITY
from urbantwin.dataset.reading.manifest import pose_of_matrix
from urbantwin.fidelity.frame import Boxes
from urbantwin.geometry import Pose
from urbantwin.taxonomy import ACTOR_CLASSES

__all__ = ["LABELS", "boxes_of_rows", "labels_of_message", "poses_of_frame"]

#: What messages with the labels of a frame are called in an MCAP file of ours.
LABELS = "urbantwin.Labels"


def boxes_of_rows(rows: Sequence[Mapping[str, Any]]) -> Boxes:
    """Return the boxes of a frame from its rows, as ``exports.frames.box_rows`` writes them.

    Raises:
        ValueError, KeyError, TypeError: a row lacks something, or holds what is no number.
    """
    box = np.array([[float(row[name]) for name in BOX] for row in rows], np.float64)
    box = box.reshape(-1, 7)
    velocity = np.array([[float(row[name]) for name in VELOCITY] for row in rows])
    if not np.isfinite(box).all() or not (box[:, 3:6] > 0).all():
        raise ValueError("a box without a size")
    hidden = [np.nan if row["occlusion"] is None else float(row["occlusion"]) for row in rows]
    names = [str(row["class"]) for row in rows]
    return Boxes(
        box=box,
        class_names=tuple(name if name in ACTOR_CLASSES else "other" for name in names),
        track=np.array([int(row["track"]) for row in rows], np.int64),
        source_names=tuple(names),
        velocity=velocity.reshape(-1, 3),
        num_points=np.array([int(row["num_points"]) for row in rows], np.int64),
        occlusion=np.array(hidden, np.float64),
        ignored=tuple(str(row["ignored"] or "") for row in rows),
    )


def poses_of_frame(told: Mapping[str, Any]) -> tuple[Pose, np.ndarray[Any, np.dtype[np.float64]]]:
    """Return site_SE3_frame, and where each sensor is in the frame of the points (S, 3).

    Raises:
        ValueError, KeyError, TypeError: a matrix is none of a pose.
    """
    site_SE3_frame = pose_of_matrix(told["site_SE3_frame"])
    sensors = [pose_of_matrix(rows).translation for rows in told["site_SE3_sensors"].values()]
    places = np.array(sensors, np.float64).reshape(-1, 3)
    return site_SE3_frame, site_SE3_frame.inverse().apply(places)


def labels_of_message(data: bytes, file: Path, place: str) -> tuple[str, dict[str, Any]]:
    """Return the name of a frame, and its boxes, pose and sensors as `Frame` has them.

    Raises:
        InputError: it is not JSON.
        ValueError, KeyError, TypeError: it is not laid out as labels are.
    """
    told = json_value(data, file=f"{file}: {place}", expected="the labels of a frame")
    pose, places = poses_of_frame(told)
    boxes = boxes_of_rows(told["boxes"])
    return str(told["name"]), {
        "boxes": boxes,
        "world_SE3_frame": pose,
        "sensor_places": places,
    }
