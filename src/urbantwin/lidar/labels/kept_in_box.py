"""What keeps the points that an actor returned inside its box.

Boxes are the tight bounds of the posed mesh (`compiled.boxes`), so pitch and roll are inside them.

A labelled point lies inside its box by construction, to 2 cm. Range noise moves a point along its
ray, and would carry some out of a box that touches the mesh; an annotator draws a box around what
the sensor saw. So the noise of a return from an actor is drawn from the normal distribution
truncated to where the ray runs inside the actor's box, grown by `BOX_MARGIN_M` (less what the
range's quantisation can add). Points keep the label of what their ray hit: background that noise
carries into a box stays background.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["BOX_MARGIN_M", "spans_in_box"]

#: No labelled point lies farther outside its box.
BOX_MARGIN_M = 0.019


def spans_in_box(
    origin: NDArray[np.float64],
    directions: NDArray[np.float64],
    boxes: NDArray[np.float64],
    margin: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return where rays enter and leave their own boxes grown by ``margin``, metres.

    Args:
        origin: (3, M) where the rays leave.
        directions: (3, M) unit vectors.
        boxes: (7, M) a box for each ray.
        margin: metres.
    """
    start = _turned(origin - boxes[:3], boxes[6])
    along = _turned(directions, boxes[6])
    half = boxes[3:6] / 2 + margin
    # A ray along a face never meets the other two of its kind: infinitely far is right there.
    along[along == 0] = 1e-300
    one, other = (-half - start) / along, (half - start) / along
    return np.minimum(one, other).max(axis=0), np.maximum(one, other).min(axis=0)


def _turned(vectors: NDArray[np.floating], yaw: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return vectors (3, M) in frames turned by yaw (M,)."""
    c, s = np.cos(yaw), np.sin(yaw)
    x, y, z = vectors
    return np.stack([x * c + y * s, y * c - x * s, z])
