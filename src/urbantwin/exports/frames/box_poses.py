"""Poses of boxes in the site frame."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from urbantwin.dataset.reading import Frame
from urbantwin.geometry import rotation_from_ypr

__all__ = ["site_boxes"]


def site_boxes(frame: Frame) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the centres (B, 3) and rotations (B, 3, 3) of a frame's boxes in the site frame.

    Boxes are upright in the points' frame: with a tilted frame (``frame: sensor``) they are tilted
    in the site frame.
    """
    box = frame.objects.box
    turned = frame.site_SE3_dataset.rotation @ rotation_from_ypr(box[:, 6], 0.0, 0.0)
    return frame.site_SE3_dataset.apply(box[:, :3]), turned
