"""Elevation and superelevation of connecting roads, fitted to the surface of the junction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from urbantwin.roads.heights.cross_fall import line_across
from urbantwin.roads.heights.design import Pins, profile_slopes
from urbantwin.roads.heights.junction_mouth import Mouths
from urbantwin.roads.heights.profiles import hermite_profiles
from urbantwin.roads.heights.stations import Stations, stations_of
from urbantwin.roads.heights.surface import RoadSurface
from urbantwin.roads.model import ModelRoad

__all__ = ["with_fitted_heights"]

#: Spacing of the knots, metres, and how much a way may turn from one to the next, radians.
STEP_M, TURN = 2.5, 0.2
#: Offsets across a lane that the surface is sampled at.
SAMPLES = 5


def with_fitted_heights(ways: Sequence[ModelRoad], surface: RoadSurface) -> tuple[ModelRoad, ...]:
    """Return connecting roads with heights: on the surface, and smooth into the streets they join.

    Args:
        ways: connecting roads.
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
    along, across = _pins(stations, surface.mouths, surface.mouth_of)
    for side, at in enumerate(stations.edges()):
        rise[at] = np.where(along.pinned[side], along.value[side], rise[at])
        bank[at] = np.where(along.pinned[side], across.value[side], bank[at])
    elevation = hermite_profiles(stations, rise, profile_slopes(stations, rise, along))
    turn = profile_slopes(stations, bank, across)
    banks = hermite_profiles(stations, np.arctan(bank), turn / (1.0 + bank**2))
    return tuple(
        replace(road, elevation=e, bank=b)
        for road, e, b in zip(ways, elevation, banks, strict=True)
    )


def _pins(
    ways: Stations, mouths: Mouths, mouth_of: Mapping[tuple[int, str], int]
) -> tuple[Pins, Pins]:
    """Return what profiles of elevation and of bank must meet where ways meet streets."""
    links = [[road.predecessor, road.successor] for road in ways.roads]
    number = np.array(
        [
            [mouth_of.get((link.id, link.contact), -1) if link else -1 for link in pair]
            for pair in links
        ]
    ).T
    held = number >= 0
    which = np.where(held, number, 0)
    place = np.stack([ways.pose[at] for at in ways.edges()])
    t = mouths.seen_from(which, place[..., :2])[1]
    # 1 where the way runs on as the street does, out of its end or in at its start.
    sign = np.array([[1.0], [-1.0]]) * mouths.out[which]
    slope = sign * mouths.slope(which, t)
    _, bank, crown = np.moveaxis(mouths.height[which], -1, 0)
    # Along a way that bends the surface goes on in its tangent plane: grade turns into bank.
    turn = mouths.turn(which, t) - ways.bend * slope
    return (
        Pins(held, mouths.rise(which, t), ways.pace * slope),
        Pins(held, sign * (bank - np.sign(t) * crown), ways.pace * turn),
    )
