"""Where boxes stand in the site."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from urbantwin.exports.frames.source import SourceFrame
from urbantwin.geometry import rotation_from_ypr

__all__ = ["site_boxes"]


def site_boxes(frame: SourceFrame) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the middles (B, 3) and rotations (B, 3, 3) of a frame's boxes in the site.

    Boxes are upright in the frame of the points: in a frame that is tilted (``frame: sensor``)
    they are tilted in the site.
    """
    box = frame.boxes.box
    turned = frame.site_SE3_frame.rotation @ rotation_from_ypr(box[:, 6], 0.0, 0.0)
    return frame.site_SE3_frame.apply(box[:, :3]), turned
