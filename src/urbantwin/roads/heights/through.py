"""Ways through junctions: elevation and bank profiles fitted to the surface that they run on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from urbantwin.roads.heights.blend import RoadSurface
from urbantwin.roads.heights.cross_fall import line_across
from urbantwin.roads.heights.design import Pins, profile_slopes
from urbantwin.roads.heights.mouths import curvature_at
from urbantwin.roads.heights.profiles import hermite_profiles
from urbantwin.roads.heights.stations import stations_of
from urbantwin.roads.model import ModelRoad, RoadLink

__all__ = ["fitted_ways"]

#: Spacing of the knots, metres, and how much a way may turn from one to the next, radians.
STEP_M, TURN = 2.5, 0.2
#: Offsets across a lane that the surface is sampled at.
SAMPLES = 5


def fitted_ways(
    ways: Sequence[ModelRoad], streets: Mapping[int, ModelRoad], surface: RoadSurface
) -> tuple[ModelRoad, ...]:
    """Return connecting roads with heights: on the surface, and smooth into the streets they join.

    Args:
        ways: connecting roads.
        streets: id -> street, with heights.
        surface: the surface of the streets.
    """
    if not ways:
        return ()
    stations = stations_of(ways, STEP_M, TURN)
    t = stations.across(SAMPLES)
    xy = stations.beside(t)
    z = np.zeros(t.shape)
    levels = np.array([road.level for road in ways])[stations.road]
    for level in np.unique(levels):
        here = levels == level
        z[here] = surface.height(xy[here].reshape(-1, 2), int(level)).reshape(-1, SAMPLES)
    rise, bank = line_across(t, z)
    ends = [_ends(road, streets) for road in ways]
    held = np.array([[end is not None for end in pair] for pair in ends]).T
    value = np.array([[end or (0.0,) * 4 for end in pair] for pair in ends], np.float64)
    for side, at in enumerate(stations.edges()):
        rise[at] = np.where(held[side], value[:, side, 0], rise[at])
        bank[at] = np.where(held[side], value[:, side, 2], bank[at])
    along = Pins(held, value[:, :, 0].T, value[:, :, 1].T)
    across = Pins(held, value[:, :, 2].T, value[:, :, 3].T)
    elevation = hermite_profiles(stations, rise, profile_slopes(stations, rise, along))
    turn = profile_slopes(stations, bank, across)
    banks = hermite_profiles(stations, np.arctan(bank), turn / (1.0 + bank**2))
    return tuple(
        replace(road, elevation=e, bank=b)
        for road, e, b in zip(ways, elevation, banks, strict=True)
    )


def _ends(
    road: ModelRoad, streets: Mapping[int, ModelRoad]
) -> tuple[tuple[float, float, float, float] | None, ...]:
    return tuple(
        _end(road, s, link, streets)
        for s, link in ((0.0, road.predecessor), (road.length, road.successor))
    )


def _end(
    road: ModelRoad, s: float, link: RoadLink | None, streets: Mapping[int, ModelRoad]
) -> tuple[float, float, float, float] | None:
    """Return height, slope, rise to the left and its change where a way meets a street."""
    street = streets.get(link.id) if link is not None and link.element == "road" else None
    if street is None or link is None:
        return None
    at = street.length if link.contact == "end" else 0.0
    # 1 where the way runs on as the street does.
    sign = 1.0 if (link.contact == "end") == (s == 0.0) else -1.0
    t = float(street.curve.locate(road.curve.at(s)[:, :2])[1][0])
    angle = float(street.bank.at(at)[0])
    bend = curvature_at(street, at)
    fall = float(street.crown.at(at)[0]) * float(np.sign(t))
    rise = np.tan(angle) - fall / np.cos(angle)
    grade = float(street.elevation.slope(at)[0])
    twist = float(street.bank.slope(at)[0]) / np.cos(angle) ** 2
    bow = float(street.crown.slope(at)[0]) * float(np.sign(t)) / np.cos(angle)
    slope = (grade + t * (twist - bow)) / max(1.0 - t * bend, 0.2)
    # Along the way the surface stays in its tangent plane: a bend turns grade into bank.
    own = curvature_at(road, s)
    turn = ((twist - bow) + bend * slope) / max(1.0 - t * bend, 0.2) - sign * own * slope
    # Stations of a cubic are not quite metres: what changes with them changes in that measure.
    inner = min(0.02, road.length / 50)
    a, b = road.curve.at([s, abs(s - inner)])[:, :2]
    pace = float(np.linalg.norm(b - a)) / inner
    height = float(street.heights(at, t)[0])
    return height, pace * sign * slope, sign * float(rise), pace * turn
