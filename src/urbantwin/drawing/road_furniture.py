"""Road furniture for pictures: signs, signal heads, islands.

All data are from the lane model. For a twin without one only the data of the lane network are
known: the signals at their stop lines.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from urbantwin.geometry import wrapped
from urbantwin.roads import RoadNetwork
from urbantwin.roads.marking.lines import placed
from urbantwin.roads.model import LaneModel, RoadSignal
from urbantwin.roads.signals import plate_of

__all__ = ["Head", "Sign", "heads", "islands", "signs"]


@dataclass(frozen=True)
class Sign:
    """A static sign.

    Attributes:
        name: readable name.
        plate: the shape of its plate: disc, upright, octagon or triangle.
        country, type, subtype, value, unit: its meaning (``roads.model.RoadSignal``).
        x, y: its position, site frame, metres.
        yaw: heading of the traffic it applies to, radians.
    """

    name: str
    plate: str
    country: str
    type: str
    subtype: str
    value: float
    unit: str
    x: float
    y: float
    yaw: float


@dataclass(frozen=True)
class Head:
    """A head of a signal.

    Attributes:
        type: OpenDRIVE's number of its type; empty if unknown.
        program: id of its signal program.
        links: indices of its signals in the program's states.
        lane: id of the lane that it controls; empty if unknown.
        z: height of its middle above the road, metres; 0 if unknown.
        x, y: its position, site frame, metres.
        yaw: heading of the traffic it applies to, radians.
    """

    type: str
    program: str
    links: tuple[int, ...]
    lane: str
    z: float
    x: float
    y: float
    yaw: float


def islands(network: RoadNetwork, model: LaneModel | None) -> list[tuple[str, shapely.Polygon]]:
    """Return raised areas between lanes: their kind (``median``, ``island``) and outline."""
    found = [
        (lane.kind, lane.polygon) for lane in network.lanes if lane.kind in ("median", "island")
    ]
    for area in model.areas if model else ():
        if model and area.kind == "trafficIsland" and len(area.corners) >= 3:
            outline = shapely.Polygon(placed(model, area.road, area.s, area.corners))
            found.append(("island", shapely.make_valid(outline)))
    return found


def signs(model: LaneModel | None) -> list[Sign]:
    """Return the signs of a lane model."""
    return [
        Sign(
            one.name, plate_of(one), one.country, one.type, one.subtype, one.value, one.unit,
            *_stands(model, one),
        )
        for one in (model.signals if model else ())
        if model and not one.dynamic
    ]  # fmt: skip


def heads(network: RoadNetwork, model: LaneModel | None) -> list[Head]:
    """Return the heads of signals at their positions; without a lane model at their stop lines."""
    found = [
        Head(one.type, one.program, one.links, one.strip, one.z, *_stands(model, one))
        for one in (model.signals if model else ())
        if model and one.dynamic
    ]
    if found:
        return found
    return [Head("", h.program, h.links, h.lane, 0.0, h.x, h.y, h.yaw) for h in network.signals]


def _stands(model: LaneModel, signal: RoadSignal) -> tuple[float, float, float]:
    """Return place and heading of the traffic of a signal or sign."""
    x, y, heading = (float(value) for value in model.road_by_id[signal.road].curve.at(signal.s)[0])
    x, y = x - signal.t * np.sin(heading), y + signal.t * np.cos(heading)
    yaw = heading + (np.pi if signal.orientation == "-" else 0.0)
    return float(x), float(y), wrapped(float(yaw))
