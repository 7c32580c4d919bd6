"""Lines that guide turning traffic over wide junctions."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from urbantwin.roads.marking.lines import MOTOR, Line
from urbantwin.roads.model import LaneModel

__all__ = ["guide_lines"]

#: Ways that turn less, or that are shorter, are found without a line: radians, metres.
TURN, LENGTH_M = np.radians(50.0), 22.0
STEP_M = 0.5


def guide_lines(model: LaneModel) -> Iterator[Line]:
    """Yield the outer border of every long turn across oncoming traffic at signals."""
    controlled = {junction for item in model.controllers for junction in item.junctions}
    inner = 1.0 if model.driving_side == "right" else -1.0
    for road in model.roads:
        if road.junction not in controlled or road.length < LENGTH_M:
            continue
        section = road.sections[0]
        lane = section.lanes[0]
        s = np.linspace(0.0, road.length, int(road.length / STEP_M) + 2)
        heading = np.unwrap(road.curve.at(s)[:, 2])
        if lane.kind not in MOTOR or inner * (heading[-1] - heading[0]) < TURN:
            continue
        # A connecting road's one lane has its reference line on its left or right: the border away
        # from the turn's centre is the one towards the kerb.
        t = road.middle(section, lane, s) - inner * lane.width.at(s) / 2
        yield Line("guide", road.place(s, t)[:, :2], road.level, lane.strip)
