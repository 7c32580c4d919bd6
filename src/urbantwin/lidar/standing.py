"""Poses of actors in their boxes: at the mean of the times at which beams met them."""

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
    """A actors where they stand in their boxes, in some frame.

    Attributes:
        rotation: (A, 3, 3) of each actor's asset.
        place: (A, 3).
        boxes: (A, 7) x, y, z, length, width, height, yaw.
    """

    rotation: NDArray[np.float64]
    place: NDArray[np.float64]
    boxes: NDArray[np.float64]


def seen_at(met: Sequence[Layers], actors: int) -> NDArray[np.float64]:
    """Return when beams met each actor (A,), the mean over all turns; ``nan``: none did."""
    total, beams = np.zeros(actors), np.zeros(actors)
    for one in met:
        beams += one.seen
        total += np.where(one.seen > 0, one.seen_s * one.seen, 0.0)
    return total / np.where(beams > 0, beams, np.nan)


def standing_at(
    when_s: NDArray[np.float64], actors: PresentActors, frame_SE3_site: Pose
) -> Standing:
    """Return actors where they stand at times (A,) of their own, with tight boxes."""
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
    """Return the boxes (A, 7) that actors have in all of their track, the tight one without a size.

    A box of a size stands over the actor's origin, which is on the ground, or so far ahead of it,
    and turns with its heading; half its height goes the way that is up for the actor.
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
