"""A virtual camera at the first sensor, for formats that require a camera.

It looks along x of the points' frame and is level with it. Image size and lens are those of KITTI's
left colour camera (Geiger et al. 2013, "Vision meets Robotics"; calibration of frame 000000 of the
object benchmark).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from urbantwin.dataset.reading import Frame
from urbantwin.exports.frames.source import FrameSource
from urbantwin.geometry import Pose, box_corners

__all__ = ["IMAGE", "PROJECTION", "camera_SE3_frame", "rectangle"]

#: Width and height of the image, pixels.
IMAGE = (1242, 375)
#: (3, 4): projection from the rectified camera's frame (x right, y down, z forward) to pixels.
PROJECTION = np.array(
    [[721.5377, 0, 609.5593, 0], [0, 721.5377, 172.854, 0], [0, 0, 1, 0]], np.float64
)
#: x forward, y left, z up -> x right, y down, z forward.
_TURN = np.array([[0, -1, 0], [0, 0, -1], [1, 0, 0]], np.float64)
#: Near plane of the camera, metres.
_NEAREST_M = 0.1
#: Smallest visible side of a rectangle, pixels; labels have two decimals.
_LEAST_PIXELS = 0.01
#: Corners of ``box_corners`` that an edge joins.
_EDGES = np.array([[k, (k + 1) % 4] for k in range(4)] + [[k, k + 4] for k in range(4)]
                  + [[4 + k, 4 + (k + 1) % 4] for k in range(4)])  # fmt: skip


def camera_SE3_frame(source: FrameSource, frame: Frame) -> Pose:  # noqa: N802
    """Return the transform from a frame's points to the camera."""
    first = source.sensors[0]["name"]
    at = frame.site_SE3_dataset.inverse().apply(frame.site_SE3_sensors[first].translation[None])[0]
    return Pose(_TURN, -_TURN @ at + 0.0)


def rectangle(box: NDArray[np.float64], camera_SE3_lidar: Pose) -> tuple[float, ...] | None:
    """Return left, top, right, bottom of a box (7,) in the image, clipped to its borders, pixels.

    ``None`` if no part is in the image. Parts behind the near plane are cut off before projection.
    """
    corners = camera_SE3_lidar.apply(box_corners(box))
    depth = corners[:, 2]
    start, stop = corners[_EDGES[:, 0]], corners[_EDGES[:, 1]]
    crossing = (start[:, 2] >= _NEAREST_M) != (stop[:, 2] >= _NEAREST_M)
    start, stop = start[crossing], stop[crossing]
    share = (_NEAREST_M - start[:, 2]) / (stop[:, 2] - start[:, 2])
    seen = np.vstack([corners[depth >= _NEAREST_M], start + share[:, None] * (stop - start)])
    if not len(seen):
        return None
    image = seen @ PROJECTION[:, :3].T
    pixels = image[:, :2] / image[:, 2:]
    most = np.array(IMAGE) - 1
    low, high = pixels.min(axis=0).clip(0, most), pixels.max(axis=0).clip(0, most)
    if ((high - low) < _LEAST_PIXELS).any():
        return None
    return (*low.tolist(), *high.tolist())
