"""Signal references of version 1.4: signals on another road than the one that they are for.

1.8 gives the place of such a signal in the file's own coordinates. 1.4 writes it on the road where
it stands, valid for no lane, and refers to it from the road that it is for, at the stop line: so
does RoadRunner, and CARLA takes such references for landmarks.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import shapely

from urbantwin.geometry import wrapped
from urbantwin.roads.model import LaneModel, ModelRoad, RoadSignal
from urbantwin.roads.opendrive.writing.carla import CARRIER_M, carrier
from urbantwin.roads.signals import pose_of

__all__ = ["heading_offset", "with_signal_references"]

#: ``validity`` of a signal that is for no lane of its road.
NO_LANE = (0,)
#: A signal is referred to a road this near at most, metres.
NEAR_M = 60.0
#: A signal this near to the stop line is at it, and one further than the latter has none, metres.
LINE_M, LINE_WITHIN_M = 0.5, 15.0
#: Lane offsets, and ways beyond a road's end, that do not matter, metres.
EXACT_M = 0.01


def with_signal_references(model: LaneModel) -> tuple[LaneModel, tuple[RoadSignal, ...]]:
    """Return a model with every signal on the road where it stands, and those to refer to.

    The latter are on the road that they are for, with its lanes, at the stop line: there CARLA
    stops vehicles, so a signal that stands metres before the line is referred to, too. CARLA
    measures from the lane offset and the standard from the reference line, so a signal is placed
    beside a street without an offset there; if there is none, on a road of its own, one metre long,
    on whose lane nothing drives, which signals of one arm share.
    """
    streets = [road for road in model.roads if road.junction < 0 and road.length > CARRIER_M]
    tree = shapely.STRtree([road.curve.line for road in streets])
    carriers: list[ModelRoad] = []
    standing, referred = [], []
    for signal in model.signals:
        road = model.road_by_id[signal.road]
        line = _stop_line(model, signal)
        if not signal.pose and _beside(road, signal) is not None:
            far = signal.lanes != NO_LANE and abs(line - signal.s) > LINE_M
            standing.append(replace(signal, lanes=NO_LANE) if far else signal)
            referred += [replace(signal, s=line)] if far else []
            continue
        posed = replace(signal, pose=pose_of(model, signal))
        near = np.sort(tree.query(shapely.Point(posed.pose[:2]).buffer(NEAR_M)))
        hosts = [h for k in near if (h := _beside(streets[k], posed)) is not None]
        hosts = hosts or [h for c in carriers if (h := _beside(c, posed)) is not None]
        if not hosts:
            place = np.array([posed.pose[:3]]) - [0.0, 0.0, signal.z]
            heading = posed.pose[3] + math.pi
            carriers.append(carrier(model.next_id + len(carriers), road.level, heading, place))
            found = _beside(carriers[-1], posed)
            hosts = [found] if found is not None else [signal]
        standing.append(min(hosts, key=lambda host: (round(abs(host.t), 3), host.road)))
        if signal.lanes and signal.lanes != NO_LANE:
            referred.append(replace(signal, s=line))
    roads = (*model.roads, *carriers)
    return replace(model, roads=roads, signals=tuple(standing)), tuple(referred)


def _stop_line(model: LaneModel, signal: RoadSignal) -> float:
    """Return the station of the stop line that a light is for; its own where there is none."""
    lines = [
        area.s
        for area in model.areas
        if area.name == "StopLine" and area.road == signal.road and signal.dynamic
    ]
    near = min(lines, key=lambda s: abs(s - signal.s), default=signal.s)
    return near if abs(near - signal.s) <= LINE_WITHIN_M else signal.s


def _beside(road: ModelRoad, signal: RoadSignal) -> RoadSignal | None:
    """Return a signal as it stands beside a road, if both ways to measure it agree there."""
    s = signal.s
    if signal.pose:
        s, t = (float(v[0]) for v in road.curve.locate([signal.pose[:2]]))
    if not -EXACT_M <= s <= road.length + EXACT_M or abs(float(road.offset.at(s)[0])) > EXACT_M:
        return None
    if not signal.pose:
        return signal
    z = signal.pose[2] - float(road.elevation.at(s)[0])
    hosted = replace(signal, road=road.id, s=s, t=t, z=z)
    if not signal.lanes:
        return hosted
    along = math.cos(signal.pose[3] - float(road.curve.at(s)[0, 2])) < 0
    return replace(hosted, lanes=NO_LANE, orientation="+" if along else "-")


def heading_offset(road: ModelRoad, signal: RoadSignal) -> float:
    """Return how far a signal is turned from facing the traffic of its orientation, radians."""
    if not signal.pose:
        return 0.0
    facing = float(road.curve.at(signal.s)[0, 2]) + (0.0 if signal.orientation == "-" else math.pi)
    return wrapped(signal.pose[3] - facing)
