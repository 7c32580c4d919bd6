"""Adaptations of a lane model to CARLA: crosswalks without lane offsets, German sign numbers."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from urbantwin.roads.model import (
    Curve,
    LaneModel,
    LaneSection,
    ModelRoad,
    Piece,
    Profile,
    RoadArea,
    RoadSignal,
    SectionLane,
)
from urbantwin.roads.signals import meaning_of

__all__ = ["CARRIER_M", "PLATES", "carrier", "with_carla_crosswalks", "with_carla_signs"]

#: Length and width of a road that only carries an object, metres.
CARRIER_M = 1.0
CARRIER_WIDTH_M = 0.1
#: CARLA 0.9.16, ``carla.LandmarkType``: MaximumSpeed, StopSign, YieldSign.
NUMBERS = {"limit": "274", "stop": "206", "yield": "205"}
#: Speeds with plates in CARLA, km/h; it only creates limits of these subtypes, and applies the
#: value (``TrafficLightManager.cpp``, ``SpeedLimitModels``).
PLATES = range(30, 100, 10)
KM_H = {"mph": 1.609344, "m/s": 3.6}


def with_carla_crosswalks(model: LaneModel) -> LaneModel:
    """Return a lane model whose crosswalks lie on roads without a lane offset.

    CARLA 0.9.16 measures crosswalks from the lane offset, the standard from the reference line:
    both agree only for a zero offset. A crosswalk keeps its position, but is assigned to the
    nearest such street of its junction. If there is none, it gets a road of its own, one metre
    long, without traffic.
    """
    streets: dict[int, set[int]] = {}
    for junction in model.junctions:
        streets[junction.id] = {c.incoming for c in junction.connections}
    for road in model.roads:
        for link in (road.predecessor, road.successor):
            if link is not None and link.element == "junction" and link.id in streets:
                streets[link.id].add(road.id)
    areas: list[RoadArea] = []
    carriers: list[ModelRoad] = []
    for area in model.areas:
        road = model.road_by_id[area.road]
        if area.kind != "crosswalk" or _is_open(road, area.s):
            areas.append(area)
            continue
        points = _placed(area, road)
        choice = [model.road_by_id[k] for k in sorted(streets.get(road.junction, ()))]
        maybe = [_hosted(area, points, street) for street in choice]
        hosts = [host for host in maybe if host is not None]
        if hosts:
            areas.append(min(hosts, key=lambda host: _distance(host.corners)))
            continue
        heading = float(road.curve.at(area.s)[0, 2])
        carriers.append(carrier(model.next_id + len(carriers), road.level, heading, points))
        local_corners = _local(points, carriers[-1], CARRIER_M / 2)
        areas.append(replace(area, road=carriers[-1].id, s=CARRIER_M / 2, corners=local_corners))
    return replace(model, roads=(*model.roads, *carriers), areas=tuple(areas))


def _is_open(road: ModelRoad, s: float) -> bool:
    return abs(float(road.offset.at(s)[0])) < 1e-4


def _hosted(area: RoadArea, points: NDArray[np.float64], street: ModelRoad) -> RoadArea | None:
    middle = points[:, :2].mean(axis=0)
    s = float(np.clip(street.curve.locate(middle)[0][0], 0.0, street.length))
    if not _is_open(street, s):
        return None
    return replace(area, road=street.id, s=s, corners=_local(points, street, s))


def _distance(corners: NDArray[np.float64]) -> float:
    return round(float(np.hypot(corners[:, 0], corners[:, 1]).min()), 6)


def _local(points: NDArray[np.float64], road: ModelRoad, s: float) -> NDArray[np.float64]:
    """Return points (N, 3) of the site frame as ahead, left, up of a place on a road."""
    x, y, heading = road.curve.at(s)[0]
    gap = points - [x, y, float(road.elevation.at(s)[0])]
    c, sn = math.cos(heading), math.sin(heading)
    return np.column_stack(
        [gap[:, 0] * c + gap[:, 1] * sn, gap[:, 1] * c - gap[:, 0] * sn, gap[:, 2]]
    )


def _placed(area: RoadArea, road: ModelRoad) -> NDArray[np.float64]:
    """Return the corners (N, 3) of an area in the site frame."""
    x, y, heading = road.curve.at(area.s)[0]
    c, sn = math.cos(heading), math.sin(heading)
    u, v, up = area.corners.T
    return np.column_stack(
        [x + u * c - v * sn, y + u * sn + v * c, float(road.elevation.at(area.s)[0]) + up]
    )


def carrier(number: int, level: int, heading: float, points: NDArray[np.float64]) -> ModelRoad:
    """Return a short road without traffic, centred on points (N, 3)."""
    x, y, z = points.mean(axis=0)
    back = CARRIER_M / 2
    line = Piece(
        float(x) - back * math.cos(heading),
        float(y) - back * math.sin(heading),
        heading,
        CARRIER_M,
    )
    lane = SectionLane(-1, "none", Profile.constant(CARRIER_WIDTH_M), forward=True)
    none = Profile.constant(0.0)
    return ModelRoad(
        id=number,
        name="",
        kind="",
        ways=(),
        junction=-1,
        curve=Curve((line,)),
        offset=none,
        elevation=Profile.constant(float(z)),
        bank=none,
        crown=none,
        sections=(LaneSection(0.0, (lane,)),),
        level=level,
    )


def with_carla_signs(model: LaneModel) -> LaneModel:
    """Return a lane model whose signs have German numbers and limits in km/h."""
    return replace(model, signals=tuple(map(_german, model.signals)))


def _german(signal: RoadSignal) -> RoadSignal:
    meaning = None if signal.dynamic else meaning_of(signal)
    if meaning is None:
        return signal
    value, unit = signal.value, signal.unit
    if unit in KM_H and math.isfinite(value):
        value, unit = float(round(value * KM_H[unit])), "km/h"
    subtype = "-1"
    if meaning == "limit" and math.isfinite(value):
        subtype = str(min(PLATES, key=lambda plate: abs(plate - value)))
    return replace(
        signal, country="DE", type=NUMBERS[meaning], subtype=subtype, value=value, unit=unit
    )
