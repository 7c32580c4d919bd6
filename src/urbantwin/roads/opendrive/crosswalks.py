"""Crosswalks where CARLA finds them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from urbantwin.roads.model import LaneModel, ModelRoad, RoadArea

__all__ = ["on_streets"]


def on_streets(model: LaneModel) -> LaneModel:
    """Return a lane model whose crosswalks lie on no connecting road.

    CARLA 0.9.16 measures objects from the lane offset, which is zero on streets of our making and
    half a lane on connecting roads; the standard measures from the reference line. A crosswalk
    keeps its place: only the road whose frame it is written in changes, to the nearest street of
    the junction.
    """
    streets: dict[int, set[int]] = {}
    for junction in model.junctions:
        streets[junction.id] = {c.incoming for c in junction.connections}
    for road in model.roads:
        for link in (road.predecessor, road.successor):
            if link is not None and link.element == "junction" and link.id in streets:
                streets[link.id].add(road.id)
    areas = []
    for area in model.areas:
        road = model.road_by_id[area.road]
        if area.kind != "crosswalk" or road.junction < 0:
            areas.append(area)
            continue
        choice = [model.road_by_id[k] for k in sorted(streets.get(road.junction, ()))]
        areas.append(_nearest(area, road, choice))
    return replace(model, areas=tuple(areas))


def _nearest(area: RoadArea, road: ModelRoad, choice: list[ModelRoad]) -> RoadArea:
    points = _placed(area, road)
    best: tuple[float, RoadArea] | None = None
    for street in choice:
        s = float(np.clip(street.curve.locate(points[:, :2].mean(axis=0))[0][0], 0, street.length))
        x, y, heading = street.curve.at(s)[0]
        gap = points - [x, y, float(street.elevation.at(s)[0])]
        c, sn = math.cos(heading), math.sin(heading)
        corners = np.column_stack(
            [gap[:, 0] * c + gap[:, 1] * sn, gap[:, 1] * c - gap[:, 0] * sn, gap[:, 2]]
        )
        distance = float(np.hypot(corners[:, 0], corners[:, 1]).min())
        if best is None or distance < best[0] - 1e-9:
            best = distance, replace(area, road=street.id, s=s, corners=corners)
    return area if best is None else best[1]


def _placed(area: RoadArea, road: ModelRoad) -> np.ndarray:
    """Return the corners (N, 3) of an area in the site frame."""
    x, y, heading = road.curve.at(area.s)[0]
    c, sn = math.cos(heading), math.sin(heading)
    u, v, up = area.corners.T
    return np.column_stack(
        [x + u * c - v * sn, y + u * sn + v * c, float(road.elevation.at(area.s)[0]) + up]
    )
