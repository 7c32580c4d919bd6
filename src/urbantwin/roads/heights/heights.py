"""Heights of all roads from the ground, in stages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from urbantwin.ground import Elevation
from urbantwin.roads.grade_separation import Lift
from urbantwin.roads.heights.cross_fall import (
    FINE_M,
    cross_falls,
    limits_of,
    line_across,
    run_out,
    smooth_step,
)
from urbantwin.roads.heights.design import Pins, design_profiles, profile_slopes, smoothed
from urbantwin.roads.heights.junction_mouth import Mouths, levels_at_ends
from urbantwin.roads.heights.overlap import NO_OVERLAPS, Overlaps, find_overlaps
from urbantwin.roads.heights.stations import SHARPEST, RoadGround, Stations, stations_of
from urbantwin.roads.heights.surface import Base, RoadSurface
from urbantwin.roads.model import LaneModel, ModelRoad, Profile

__all__ = ["hermite_profiles", "with_heights"]

#: Spacing of the stations for the design of streets, and for their areas, metres.
STEP_M, DENSE_M = 2.5, 1.0
#: Number of samples of the smoothed ground across a carriageway, and of the surface of other
#: streets.
SAMPLES, SAMPLES_YIELDING = 7, 15
#: Length over which a street departs from another one that it followed, metres.
EASING_M = 15.0
#: Additional weight of samples on another street.
SHARED_WEIGHT = 500.0
#: Maximum deviation of a smoothed street from the ground, metres: on a coarse DEM without cuts and
#: fills, and on one that shows them.
EARTHWORK_M, EARTHWORK_SEEN_M = 0.5, 0.1
#: Distance to both sides for slopes of the ground, metres.
SLOPE_REACH_M = 1.0
#: Smoothing length of the bank, metres.
BANK_SMOOTHING_M = 2.0
#: Decimals of heights (metres) and slopes that are kept.
DIGITS = 9
#: Pieces with less curvature are straight, 1/m.
STRAIGHT = 1e-8
#: Spacing of the knots on connecting roads, metres, and maximum turn between them, radians.
STEP_CONNECTING_M, TURN_CONNECTING = 2.5, 0.2
#: Number of samples of the surface across a lane.
SAMPLES_CONNECTING = 5


def with_heights(
    model: LaneModel, elevation: Elevation, lift: Lift
) -> tuple[LaneModel, RoadSurface]:
    """Return the model with elevation, superelevation and crown of all roads, and its surface.

    Args:
        model: the lanes in plan.
        elevation: the ground.
        lift: height of roads above the ground.
    """
    streets = [road for road in model.roads if road.junction < 0]
    connecting = [road for road in model.roads if road.junction >= 0]
    all_stations = stations_of([*streets, *connecting], DENSE_M)
    base = RoadGround(elevation, lift, _carriageway(all_stations))
    site = _Site(elevation, base, {junction.id: junction.level for junction in model.junctions})
    risen = _streets(streets, site, NO_OVERLAPS)
    overlaps = find_overlaps(risen, connecting, all_stations)
    if overlaps.calm:
        redone = [k for k, road in enumerate(streets) if road.id in overlaps.calm]
        first = [k for k in redone if streets[k].id not in overlaps.yielding]
        _replace_at(risen, first, _streets([streets[k] for k in first], site, overlaps))
        fixed_index = [k for k, road in enumerate(streets) if road.id not in overlaps.yielding]
        fixed_roads = [*(risen[k] for k in fixed_index), *connecting]
        fixed_index += range(len(streets), len(streets) + len(connecting))
        surface = RoadSurface(
            model.with_roads(tuple(fixed_roads)), base, all_stations.pick(fixed_roads, fixed_index)
        )
        last = [k for k in redone if streets[k].id in overlaps.yielding]
        _replace_at(risen, last, _streets([streets[k] for k in last], site, overlaps, surface))
    surface = RoadSurface(model.with_roads((*risen, *connecting)), base, all_stations)
    finished = {road.id: road for road in (*risen, *with_fitted_heights(connecting, surface))}
    return model.with_roads(tuple(finished[road.id] for road in model.roads)), surface


def _replace_at(roads: list[ModelRoad], which: Sequence[int], other: Sequence[ModelRoad]) -> None:
    for k, road in zip(which, other, strict=True):
        roads[k] = road


@dataclass(frozen=True)
class _Site:
    """The ground, its regression under roads, and the levels of junctions by id."""

    elevation: Elevation
    ground: RoadGround
    levels: dict[int, int]


def _carriageway(stations: Stations) -> NDArray[np.float64]:
    """Return points (N, 2) on the carriageways of the ground level, about a metre apart."""
    ground = np.array([road.level == 0 for road in stations.roads], bool)[stations.road]
    width = stations.left - stations.right
    count = np.where(ground, np.ceil(width).astype(int) + 1, 0)
    row = np.repeat(np.arange(len(count)), count)
    share = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
    t = stations.right[row] + share / np.maximum(count[row] - 1, 1) * width[row]
    x, y, heading = stations.pose[row].T
    return np.column_stack([x - t * np.sin(heading), y + t * np.cos(heading)])


def _streets(
    streets: Sequence[ModelRoad],
    site: _Site,
    overlaps: Overlaps,
    surface: RoadSurface | None = None,
) -> list[ModelRoad]:
    """Return streets with heights, on the ground or on the surface of other streets."""
    if not streets:
        return []
    base: Base = surface.height if surface else site.ground
    elevation = site.elevation
    stations = stations_of(streets, STEP_M)
    limits = [limits_of(road) for road in streets]
    t = stations.across(SAMPLES_YIELDING if surface else SAMPLES)
    ends = stations.edges()
    level = np.array([road.level for road in streets])[stations.road]
    # At a junction on the ground, a ramp joins the ground's surface.
    for end_index, number in zip(ends, levels_at_ends(streets, site.levels), strict=True):
        level[end_index] = number
    z = _sampled(stations.beside(t), level, base)
    weight = np.ones_like(t)
    if surface:
        on_street = _sampled(stations.beside(t), level, surface.on_streets)
        weight += SHARED_WEIGHT * on_street
        z = _eased(stations, t, z, weight, on_street.max(axis=1) > 0.0)
    share = run_out(stations, overlaps.calm)
    lifted = _lifted(stations, site.ground)
    cross = cross_falls(stations, t, z, weight, elevation, limits, lifted, share)
    held = np.array([(r.predecessor is not None, r.successor is not None) for r in streets]).T
    grade = np.stack([_grades(stations, end_index, (t, weight), level, base) for end_index in ends])
    height = np.stack([cross.ground[end_index] for end_index in ends])
    tilt = np.stack([cross.tilt[end_index] for end_index in ends])
    bend = np.clip(stations.bend, -SHARPEST, SHARPEST)
    along, across = Pins(held, height, grade), Pins(held, tilt, -bend * grade)
    earthwork = EARTHWORK_M if elevation.detail > FINE_M else EARTHWORK_SEEN_M
    calm = BANK_SMOOTHING_M
    if surface:  # others' shape is followed, not smoothed
        earthwork, calm = 0.0, 1.0
    height = design_profiles(stations, cross.level, along, limits, earthwork)
    bank = smoothed(stations, cross.bank, across, np.full(len(streets), calm))
    elevations = hermite_profiles(stations, height, profile_slopes(stations, height, along))
    turn = profile_slopes(stations, bank, across)
    banks = hermite_profiles(stations, np.arctan(bank), turn / (1.0 + bank**2))
    fall = cross.crown[stations.road] * share
    level_ends = Pins(held, np.zeros(held.shape), np.zeros(held.shape))
    crowns = hermite_profiles(stations, fall, profile_slopes(stations, fall, level_ends))
    return [
        replace(road, elevation=e, bank=b, crown=c)
        for road, e, b, c in zip(streets, elevations, banks, crowns, strict=True)
    ]


def _eased(
    stations: Stations,
    t: NDArray[np.float64],
    z: NDArray[np.float64],
    weight: NDArray[np.float64],
    on: NDArray[np.bool_],
) -> NDArray[np.float64]:
    """Return ground (M, K) with a gradual transition where streets depart from another street.

    The difference between the other street (``on``, (M,)) and the ground fades out over
    ``EASING_M`` along the road, or up to its end if that is nearer.
    """
    free, held = line_across(t, z), line_across(t, z, weight)
    ask = [b - a for a, b in zip(free, held, strict=True)]
    z = z.copy()
    for k in range(len(stations.roads)):
        part = stations.of(k)
        on_index = np.flatnonzero(on[part])
        if not len(on_index) or len(on_index) == part.stop - part.start:
            continue
        s = stations.s[part]
        nearest = on_index[np.abs(s[:, None] - s[on_index]).argmin(axis=1)]
        room = np.where(s < s[nearest], s[nearest], s[-1] - s[nearest])
        distance = np.abs(s - s[nearest]) / np.maximum(np.minimum(EASING_M, room), 1e-9)
        share = np.where(on[part], 0.0, 1.0 - smooth_step(distance))
        level, slope = (share * value[part][nearest] for value in ask)
        z[part] += level[:, None] + slope[:, None] * t[part]
    return z


def _sampled(xy: NDArray[np.float64], level: NDArray[np.int64], base: Base) -> NDArray[np.float64]:
    """Return heights of the base (M, K) at points (M, K, 2) on levels (M,)."""
    z = np.zeros(xy.shape[:2])
    for number in np.unique(level):
        on_level = level == number
        z[on_level] = base(xy[on_level].reshape(-1, 2), int(number)).reshape(-1, xy.shape[1])
    return z


def _grades(
    stations: Stations,
    at: NDArray[np.int64],
    across: tuple[NDArray[np.float64], NDArray[np.float64]],
    level: NDArray[np.int64],
    base: Base,
) -> NDArray[np.float64]:
    """Return the slope (R,) of the ground along streets at stations ``at``."""
    t, weight = across
    heading = stations.pose[at, 2]
    ahead = np.stack([np.cos(heading), np.sin(heading)], -1)[:, None] * SLOPE_REACH_M
    xy = stations.beside(t)[at]
    rise = _sampled(xy + ahead, level[at], base) - _sampled(xy - ahead, level[at], base)
    return line_across(t[at], rise / (2.0 * SLOPE_REACH_M), weight[at])[0]


def _lifted(stations: Stations, base: RoadGround) -> NDArray[np.bool_]:
    """Return the mask (R,) of roads that are above the ground somewhere."""
    is_raised = np.array([road.level > 0 for road in stations.roads])
    lift = base.lift_at(stations.pose[:, :2], 0)
    return is_raised | (np.maximum.reduceat(lift, stations.first[:-1]) > 0.02)


def hermite_profiles(
    stations: Stations, value: NDArray[np.float64], slope: NDArray[np.float64]
) -> list[Profile]:
    """Return a profile per road with given values (M,) and slopes (M,) at its stations.

    Straight lines are one piece, however long.
    """
    # The solvers' rounding noise is removed.
    value, slope = np.round(value, DIGITS) + 0.0, np.round(slope, DIGITS) + 0.0
    inner = np.ones(len(value) - 1, bool)
    inner[stations.edges()[1][:-1]] = False
    step = np.where(inner, np.diff(stations.s), 1.0)
    rise = np.diff(value)
    c = (3.0 * rise - step * (2.0 * slope[:-1] + slope[1:])) / step**2
    d = (step * (slope[:-1] + slope[1:]) - 2.0 * rise) / step**3
    abcd = np.column_stack([value[:-1], slope[:-1], c, d])
    # A piece that continues the straight line before it is left out.
    line = np.abs(abcd[:, 2:] * [1.0, 10.0]).max(axis=1) < STRAIGHT
    goes_on = np.zeros(len(abcd), bool)
    goes_on[1:] = line[1:] & line[:-1] & (np.abs(np.diff(abcd[:, 1])) < STRAIGHT)
    goes_on[stations.first[:-1]] = False
    profiles = []
    for k in range(len(stations.roads)):
        part = slice(int(stations.first[k]), int(stations.first[k + 1]) - 1)
        keep = ~goes_on[part]
        profiles.append(Profile(stations.s[part][keep], abcd[part][keep]))
    return profiles


def with_fitted_heights(ways: Sequence[ModelRoad], surface: RoadSurface) -> tuple[ModelRoad, ...]:
    """Return connecting roads with heights on the surface, continuous with the linked streets.

    Args:
        ways: connecting roads.
        surface: the surface of the streets.
    """
    if not ways:
        return ()
    stations = stations_of(ways, STEP_CONNECTING_M, TURN_CONNECTING)
    t = stations.across(SAMPLES_CONNECTING)
    xy = stations.beside(t)
    z = np.zeros(t.shape)
    levels = np.array([road.level for road in ways])[stations.road]
    for level in np.unique(levels):
        on_level = levels == level
        z[on_level] = surface.height(xy[on_level].reshape(-1, 2), int(level)).reshape(
            -1, SAMPLES_CONNECTING
        )
    rise, bank = line_across(t, z)
    along, across = _pins(stations, surface.mouths, surface.mouth_of)
    for side, end_index in enumerate(stations.edges()):
        rise[end_index] = np.where(along.pinned[side], along.value[side], rise[end_index])
        bank[end_index] = np.where(along.pinned[side], across.value[side], bank[end_index])
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
    """Return the boundary conditions of elevation and bank where connecting roads join streets."""
    links = [[road.predecessor, road.successor] for road in ways.roads]
    number = np.array(
        [
            [mouth_of.get((link.id, link.contact), -1) if link else -1 for link in pair]
            for pair in links
        ]
    ).T
    held = number >= 0
    mouth_index = np.where(held, number, 0)
    place = np.stack([ways.pose[end_index] for end_index in ways.edges()])
    t = mouths.seen_from(mouth_index, place[..., :2])[1]
    # 1 where the connecting road runs along the street's direction, -1 against it.
    sign = np.array([[1.0], [-1.0]]) * mouths.out[mouth_index]
    slope = sign * mouths.slope(mouth_index, t)
    _, bank, crown = np.moveaxis(mouths.height[mouth_index], -1, 0)
    # Along a curved path the surface is its tangent plane: grade turns into bank.
    turn = mouths.turn(mouth_index, t) - ways.bend * slope
    return (
        Pins(held, mouths.rise(mouth_index, t), ways.pace * slope),
        Pins(held, sign * (bank - np.sign(t) * crown), ways.pace * turn),
    )
