"""Carriageways in plan, from the lane model."""

from __future__ import annotations

import numpy as np
import shapely

from urbantwin.geometry import area_union
from urbantwin.roads.model.model import LaneModel
from urbantwin.roads.network import CARRIAGEWAY_KINDS

__all__ = ["carriageway_in_plan"]

STEP_M = 2.0


def carriageway_in_plan(model: LaneModel, area: shapely.Polygon) -> shapely.Geometry:
    """Return the union of the lanes for vehicles that lie at ground level and meet ``area``."""
    pieces = []
    shapely.prepare(area)
    for road in model.roads:
        if road.level:
            continue
        for section, end in zip(road.sections, road.section_ends, strict=True):
            lanes = [lane for lane in section.lanes if lane.kind in CARRIAGEWAY_KINDS]
            if not lanes or end <= section.s:
                continue
            s = np.linspace(section.s, end, max(2, int((end - section.s) / STEP_M) + 1))
            line = shapely.LineString(road.curve.beside(s, np.zeros(len(s))))
            if not shapely.dwithin(line, area, 60.0):
                continue
            for lane in lanes:
                sides = [
                    road.curve.beside(s, road.border(section, lane, s, outer=outer))
                    for outer in (False, True)
                ]
                strip = shapely.Polygon(np.vstack([sides[0], sides[1][::-1]]))
                pieces.append(shapely.make_valid(strip))
    return area_union([piece for piece in pieces if piece.area > 0])
