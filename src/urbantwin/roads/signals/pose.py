"""Poses of signals and signs of a lane model in the site frame."""

from __future__ import annotations

import math
from dataclasses import dataclass

from urbantwin.roads.model import LaneModel, RoadSignal

__all__ = ["Head", "heads_of", "pose_of"]


@dataclass(frozen=True)
class Head:
    """A signal or a sign with its pose.

    Attributes:
        signal: the signal or sign.
        x, y, z: its centre, site frame, metres.
        heading: direction that it faces, radians.
        level: level of its road, 0 on the ground.
        inside: whether it applies to traffic within a junction.
    """

    signal: RoadSignal
    x: float
    y: float
    z: float
    heading: float
    level: int
    inside: bool


def pose_of(model: LaneModel, signal: RoadSignal) -> tuple[float, float, float, float]:
    """Return x, y, z of a signal's centre, metres, and the heading that it faces, radians."""
    if signal.pose:
        x, y, z, heading = signal.pose
        return x, y, z, heading
    road = model.road_by_id[signal.road]
    x, y, z = (float(v) for v in road.place(signal.s, signal.t)[0])
    heading = road.curve.pose(signal.s)[2]
    # A signal faces the traffic that it applies to.
    heading += 0.0 if signal.orientation == "-" else math.pi
    return x, y, z + signal.z, math.atan2(math.sin(heading), math.cos(heading))


def heads_of(model: LaneModel) -> list[Head]:
    """Return all signals and signs of a model with their poses, in the model's order."""
    heads = []
    for signal in model.signals:
        road = model.road_by_id[signal.road]
        walkers = signal.orientation == "none"
        inside = road.junction >= 0 and not signal.pose and not walkers
        heads.append(Head(signal, *pose_of(model, signal), road.level, inside))
    return heads
