"""Static objects of events: cones and barriers on a closed lane, and lost objects."""

from __future__ import annotations

import numpy as np
import shapely

from urbantwin.roads import Lane
from urbantwin.taxonomy import OBSTACLE
from urbantwin.traffic.prescribed import PrescribedPath

__all__ = ["DEBRIS", "debris", "work_zone"]

#: Asset of the lost object.
DEBRIS = "pallet"
#: Maximum spacing of cones, metres (German rules, RSA 21: 5 m across in towns).
_CONE_SPACING_M = 3.0
#: Half of the extent of a cone and of a barrier, metres.
_HALF_CONE_M, _HALF_BARRIER_M = 0.2, 0.25


def work_zone(
    lane: Lane, from_m: float, to_m: float, width_m: float, times: tuple[float, float]
) -> list[PrescribedPath]:
    """Return barriers across a part of a lane at both ends, and cones along its sides.

    Args:
        lane: the lane.
        from_m: begin of the part, metres from the lane's start.
        to_m: end of the part.
        width_m: width of the part, centred on the lane.
        times: begin and end of the event, seconds.
    """
    bodies = [
        _static_object(lane, along_m, 0.0, "barrier", times, turned)
        for along_m, turned in ((from_m + _HALF_BARRIER_M, np.pi), (to_m - _HALF_BARRIER_M, 0.0))
    ]
    first, last = (
        from_m + 2 * _HALF_BARRIER_M + _HALF_CONE_M,
        to_m - 2 * _HALF_BARRIER_M - _HALF_CONE_M,
    )
    count = int(np.ceil(max(last - first, 0.0) / _CONE_SPACING_M)) + 1
    for along_m in np.linspace(first, last, count):
        for side in (1.0, -1.0):
            beside_m = side * (width_m / 2 - _HALF_CONE_M)
            bodies.append(_static_object(lane, float(along_m), beside_m, "cone", times))
    return bodies


def debris(lane: Lane, along_m: float, times: tuple[float, float]) -> list[PrescribedPath]:
    """Return the lost object on a lane.

    Args:
        lane: the lane.
        along_m: its centre, metres from the lane's start.
        times: begin and end of the event, seconds.
    """
    return [_static_object(lane, along_m, 0.0, DEBRIS, times)]


def _static_object(
    lane: Lane,
    along_m: float,
    left_m: float,
    asset: str,
    times: tuple[float, float],
    turned: float = 0.0,
) -> PrescribedPath:
    line = shapely.LineString(lane.centre[:, :2])
    ends = [
        shapely.get_coordinates(line.interpolate(min(max(along_m + offset_m, 0.0), line.length)))[0]
        for offset_m in (-0.5, 0.0, 0.5)
    ]
    yaw = float(np.arctan2(*(ends[2] - ends[0])[::-1]))
    place = ends[1] + left_m * np.array([-np.sin(yaw), np.cos(yaw)])
    facing = np.full(2, yaw + turned)
    span = np.array([times[0], max(times[1], times[0] + 1e-3)])
    return PrescribedPath(OBSTACLE, asset, span, np.array([place, place]), facing, np.zeros(2))
