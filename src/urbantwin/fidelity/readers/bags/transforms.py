"""Where a bag's static transforms place the frame of its points, in one sentence."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from urbantwin.fidelity.readers.bags.cloud_message import pose_of
from urbantwin.geometry import Pose
from urbantwin.geometry.pose import ypr_from_rotation

__all__ = ["TRANSFORMS", "is_static", "place_of_frame", "static_transforms"]

#: The type of messages that say where frames are, and how the topic of those that stay is called.
TRANSFORMS = "tf2_msgs/msg/TFMessage"
_STATIC = "tf_static"


def is_static(topic_name: str) -> bool:
    """Return whether a topic has the transforms that do not change."""
    return topic_name.rstrip("/").endswith(_STATIC)


def static_transforms(messages: Iterable[Any]) -> dict[str, tuple[str, Pose]]:
    """Return parent and pose in it of every frame; of several, what was said last.

    Raises:
        ValueError: a number is not finite.
    """
    found = {}
    for message in messages:
        for one in message.transforms:
            moved, turned = one.transform.translation, one.transform.rotation
            found[_name(one.child_frame_id)] = (
                _name(one.header.frame_id),
                pose_of([moved.x, moved.y, moved.z], [turned.x, turned.y, turned.z, turned.w]),
            )
    return found


def place_of_frame(frame_id: str, transforms: dict[str, tuple[str, Pose]]) -> str | None:
    """Return where a frame is in the one that all others hang on; None where nothing says it."""
    frame, pose, seen = _name(frame_id), None, set()
    while frame in transforms and frame not in seen:
        seen.add(frame)
        frame, step = transforms[frame]
        pose = step if pose is None else step @ pose
    if pose is None:
        return None
    yaw, pitch, roll = (math.degrees(angle) + 0.0 for angle in ypr_from_rotation(pose.rotation))
    x, y, z = pose.translation
    return (
        f"Points are in the frame {_name(frame_id)}; the static transforms place it in {frame} at "
        f"x {x:.3f}, y {y:.3f}, z {z:.3f} m, yaw {yaw:.2f}, pitch {pitch:.2f}, roll {roll:.2f} "
        "degrees, which is not applied."
    )


def _name(frame_id: str) -> str:
    """Return a frame's name as ROS 2 writes it, without the slash of early ROS 1."""
    return str(frame_id).lstrip("/")
