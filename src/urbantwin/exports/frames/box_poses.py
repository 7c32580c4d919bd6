"""Where boxes stand in the site, and rotations as other formats write them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from urbantwin.exports.frames.source import SourceFrame
from urbantwin.geometry import rotation_from_ypr

__all__ = ["box_rotations", "quaternion", "site_boxes"]


def box_rotations(yaw: ArrayLike) -> NDArray[np.float64]:
    """Return the rotations (B, 3, 3) of boxes of yaw (B,) in the frame that the yaw is in."""
    return rotation_from_ypr(yaw, 0.0, 0.0)


def site_boxes(frame: SourceFrame) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the middles (B, 3) and rotations (B, 3, 3) of a frame's boxes in the site.

    Boxes are upright in the frame of the points: in a frame that is tilted (``frame: sensor``)
    they are tilted in the site.
    """
    box = frame.boxes.box
    turned = frame.site_SE3_frame.rotation @ box_rotations(box[:, 6])
    return frame.site_SE3_frame.apply(box[:, :3]), turned


def quaternion(rotation: NDArray[np.float64]) -> list[float]:
    """Return w, x, y, z of a rotation (3, 3), w not negative."""
    x, y, z, w = Rotation.from_matrix(rotation).as_quat(canonical=True).tolist()
    return [w + 0.0, x + 0.0, y + 0.0, z + 0.0]
