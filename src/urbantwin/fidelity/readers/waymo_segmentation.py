"""Classes and instances of pixels of the Waymo Open Dataset's range images, as ours.

Source: ``protos/segmentation.proto`` and ``v2/perception/segmentation.py``: two numbers a pixel,
instance and class, of the top sensor alone, in part of the frames.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from urbantwin.taxonomy import semantic_id

__all__ = ["classes_of"]

#: By number: ours, or the nearest of ours, as our own street is labelled (kerbs, signal heads) and
#: as SemanticKITTI's are (standing bicycles, other vehicles).
_CLASSES = (
    "unlabelled", "car", "truck", "bus", "truck", "motorcyclist", "bicyclist", "pedestrian",
    "traffic-sign", "other-object", "pole", "other-object", "other-object", "motorcycle",
    "building", "vegetation", "trunk", "sidewalk", "road", "road", "other-ground", "terrain",
    "sidewalk",
)  # fmt: skip


def classes_of(labels: NDArray[np.integer]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return our class and the instance (0 for none) of labels (N, 2): instance, class.

    Classes that are not known are unlabelled.
    """
    ours = np.array([semantic_id(name) for name in _CLASSES], np.int64)
    instance, number = labels.astype(np.int64).T
    known = (number >= 0) & (number < len(ours))
    return np.where(known, ours[np.where(known, number, 0)], 0), np.maximum(instance, 0)
