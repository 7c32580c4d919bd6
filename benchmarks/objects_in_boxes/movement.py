"""Objects that move while several sensors look at them, one after the other.

Sensors of a vehicle meet an object at different moments of a turn: at 10 m/s its points of two
sensors that are half a turn apart lie half a metre apart. Annotators put its box where its points
are on the whole.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from objects_in_boxes.bodies import PlacedBody
from urbantwin.fidelity.frame import Boxes, Frame

__all__ = ["bodies_then", "owners_then", "shifts_of"]


def shifts_of(frame: Frame, sensor: NDArray[np.int64], margin: float) -> NDArray[np.float64]:
    """Return where objects were as each sensor saw them, less where their boxes are: (S, B, 3).

    0 where nothing says how fast they are or when points were measured.

    Args:
        frame: with boxes.
        sensor: (N,) of the points, from 0 and without gaps.
        margin: metres that boxes are grown by.
    """
    boxes = frame.boxes
    assert boxes is not None
    count = int(sensor.max()) + 1
    shift = np.zeros((count, len(boxes), 3))
    if boxes.velocity is None or frame.time_s is None or count == 1:
        return shift
    velocity = np.nan_to_num(boxes.velocity)
    # Points of who moves leave the box where it is; once more where it was.
    for _ in range(2):
        owner = owners_then(boxes, frame.points, sensor, shift, margin)
        for object_ in np.flatnonzero(np.abs(velocity).sum(axis=1)):
            mine = owner == object_
            for one in np.unique(sensor[mine]):
                seen = np.median(frame.time_s[mine & (sensor == one)])
                late = float(seen - np.median(frame.time_s[mine]))
                shift[one, object_] = velocity[object_] * late
    return shift


def owners_then(
    boxes: Boxes,
    points: NDArray[np.float64],
    sensor: NDArray[np.int64],
    shift: NDArray[np.float64],
    margin: float,
) -> NDArray[np.int64]:
    """Return the box (N,) that each point lies in, -1 for none, each where its sensor saw it.

    Args:
        boxes: of the frame.
        points: (N, 3).
        sensor: (N,) of the points.
        shift: (S, B, 3) of the boxes.
        margin: metres that boxes are grown by.
    """
    owner = np.full(len(points), -1, np.int64)
    for one, moved in enumerate(shift):
        mine = np.flatnonzero(sensor == one)
        box = boxes.box.copy()
        box[:, :3] += moved
        owner[mine] = replace(boxes, box=box).points_of(points[mine], margin)
    return owner


def bodies_then(bodies: list[PlacedBody], shift: NDArray[np.float64]) -> list[PlacedBody]:
    """Return B bodies moved by (B, 3): where a sensor saw them."""
    return [
        replace(body, box=np.concatenate([body.box[:3] + moved, body.box[3:]]))
        for body, moved in zip(bodies, shift, strict=True)
    ]
