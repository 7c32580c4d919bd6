"""Road furniture for pictures: signs, signal heads, islands.

The lane model says it all. Of a twin without one only what the lane network tells is known: the
signals at their stop lines.
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
    """A sign that does not change.

    Attributes:
        name: for people.
        plate: the shape of its plate: disc, upright, octagon or triangle.
        country, type, subtype, value, unit: what it says (``roads.model.RoadSignal``).
        x, y: its place, site frame, metres.
        yaw: heading of the traffic that it is for, radians.
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
        type: OpenDRIVE's number of it; empty where it is not known.
        program: id of its signal program.
        links: what it shows: indices into the program's states.
        lane: id of the strip that it governs; empty where that is not known.
        z: height of its middle above the road, metres; 0 where it is not known.
        x, y: its place, site frame, metres.
        yaw: heading of the traffic that it is for, radians.
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
    """Return the heads of signals where they stand; without a lane model at their stop lines."""
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
