"""Where the arrow of a short lane stands: further upstream, over what leads straight into it.

Between a crossing and the place where a carriageway parts there may be no room for an arrow; on
streets it then stands before that place, or on it, where nobody drives across.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import shapely
import shapely.ops

from urbantwin.geometry import wrapped
from urbantwin.roads.network import Lane, RoadNetwork

__all__ = ["approach_line"]

#: How far upstream the line goes, metres; ways that turn by less lead straight on, radians.
UPSTREAM_M, STRAIGHT = 20.0, np.radians(45.0)


def approach_line(network: RoadNetwork, lane: Lane) -> shapely.LineString | None:
    """Return the line along which a short signed lane's arrow stands, to the lane's end.

    It begins on the way that leads most nearly straight into the lane, and on the lane before that
    if nothing else is signed there; only lanes that nobody drives across are part of it.

    Returns:
        The line; ``None`` where the lane leads straight on to one with the same arrows, whose
        arrow serves both.
    """
    if lane.id not in network.stopped_lanes:
        for way, after in _ways(network, lane, ahead=True):
            if after.arrows == lane.arrows and _is_free(network, way):
                return None
    points = lane.centre[:, :2]
    before = sorted(
        (abs(_turn(way)), way.id, way, first)
        for way, first in _ways(network, lane, ahead=False)
        if abs(_turn(way)) < STRAIGHT and _is_free(network, way)
    )
    for _, _, way, first in before[:1]:
        points = np.vstack([way.centre[:-1, :2], points])
        if first.arrows is None or first.arrows == lane.arrows:
            points = np.vstack([first.centre[:-1, :2], points])
    line = shapely.LineString(points)
    return shapely.ops.substring(line, max(line.length - UPSTREAM_M, 0.0), line.length)


def _ways(network: RoadNetwork, lane: Lane, *, ahead: bool) -> Iterator[tuple[Lane, Lane]]:
    """Yield the ways through a junction at a lane's end or start, each with the lane beyond it."""
    for name in lane.successors if ahead else network.lanes_into.get(lane.id, ()):
        way = network.lane_by_id.get(name)
        if way is None or not way.junction:
            continue
        for other in way.successors if ahead else network.lanes_into.get(way.id, ()):
            beyond = network.lane_by_id.get(other)
            if beyond is not None and not beyond.junction:
                yield way, beyond


def _turn(way: Lane) -> float:
    legs = np.diff(way.centre[:, :2], axis=0)
    first, last = (float(np.arctan2(leg[1], leg[0])) for leg in (legs[0], legs[-1]))
    return float(wrapped(last - first))


def _is_free(network: RoadNetwork, way: Lane) -> bool:
    """Whether a way is at no signal, and only ways from or to its own lanes meet it."""
    own = {*network.lanes_into.get(way.id, ())}
    if own & network.stopped_lanes:
        return False
    line = shapely.LineString(way.centre[:, :2])
    return not any(
        line.intersects(shapely.LineString(other.centre[:, :2]))
        for other in network.lanes
        if other.junction == way.junction
        and other.kind in ("connection", "crossing")
        and not own & {other.id, *network.lanes_into.get(other.id, ())}
        and not set(other.successors) & {way.id, *way.successors}
        and other.id != way.id
    )
