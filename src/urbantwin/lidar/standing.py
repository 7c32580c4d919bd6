"""Poses and boxes of actors at the mean time of the beams that hit them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import Pose
from urbantwin.lidar.casting.tracer import Layers
from urbantwin.lidar.compiled.boxes import tight_boxes
from urbantwin.lidar.compiled.pose import poses_at
from urbantwin.lidar.shapes import PresentActors

__all__ = ["Standing", "seen_at", "standing_at", "track_boxes"]


class Standing(NamedTuple):
    """A actors at the times of their boxes, in some frame.

    Attributes:
        rotation: (A, 3, 3) of each actor's asset.
        place: (A, 3) translation.
        boxes: (A, 7) x, y, z, length, width, height, yaw.
    """

    rotation: NDArray[np.float64]
    place: NDArray[np.float64]
    boxes: NDArray[np.float64]


def seen_at(met: Sequence[Layers], actors: int) -> NDArray[np.float64]:
    """Return the mean hit time of each actor (A,) over all turns; ``nan`` without hits."""
    total, beams = np.zeros(actors), np.zeros(actors)
    for layers in met:
        beams += layers.seen
        total += np.where(layers.seen > 0, layers.seen_s * layers.seen, 0.0)
    return total / np.where(beams > 0, beams, np.nan)


def standing_at(
    when_s: NDArray[np.float64], actors: PresentActors, frame_SE3_site: Pose
) -> Standing:
    """Return actors at individual times (A,), with tight boxes."""
    turned, placed = poses_at(when_s, actors.paths)
    turned, placed = frame_SE3_site.rotation @ turned, frame_SE3_site.apply(placed)
    shapes, shape = actors.shapes, actors.shape
    first, count = shapes.first_hull[shape], shapes.hull_size[shape]
    return Standing(turned, placed, tight_boxes(turned, placed, shapes.hull, first, count))


def track_boxes(
    standing: Standing,
    sizes: Sequence[tuple[float, float, float] | None],
    ahead_m: Sequence[float],
) -> NDArray[np.float64]:
    """Return boxes (A, 7) with the size of the track; actors without a size keep the tight box.

    The box is centred above the actor's origin on the ground, or ``ahead_m`` ahead of it, and has
    its heading; half its height is added along the actor's own up axis.
    """
    boxes = standing.boxes.copy()
    sized = [number for number, size in enumerate(sizes) if size is not None]
    size = np.array([sizes[number] for number in sized]).reshape(-1, 3)
    ahead = np.array([ahead_m[number] for number in sized])
    middle = np.column_stack([ahead, np.zeros(len(sized)), size[:, 2] / 2])
    turned = standing.rotation[sized] @ middle[:, :, None]
    boxes[sized, :3] = standing.place[sized] + turned[:, :, 0]
    boxes[sized, 3:6] = size
    return boxes
