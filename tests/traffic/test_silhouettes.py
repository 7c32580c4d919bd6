"""Who rides and who walks by their outlines, of the catalogue's bodies seen from all sides."""

import numpy as np
import pytest

from urbantwin.traffic.assets import asset, asset_mesh, asset_names
from urbantwin.traffic.observed.association import tracks_of
from urbantwin.traffic.observed.box_fit import SeenObject, fitted_yaw
from urbantwin.traffic.observed.frame_times import evenly_spaced
from urbantwin.traffic.observed.observed_track import observed_track
from urbantwin.traffic.observed.silhouette import apart, silhouette

SECONDS = evenly_spaced(24, 1.0)
SIDES = np.radians(np.arange(0.0, 360.0, 45.0))


def side_seen(name, azimuth, random, count=200):
    """Points (N, 3) on the faces of a body that look towards an azimuth, above 0.3 m."""
    mesh = asset_mesh(name, 0)
    a, b, c = (mesh.vertices[mesh.faces[:, k]].astype(float) for k in range(3))
    normal = np.cross(b - a, c - a)
    towards = normal @ [np.cos(azimuth), np.sin(azimuth), 0.2]
    share = np.where(towards > 0, towards, 0.0)
    face = random.choice(len(share), 3 * count, p=share / share.sum())
    u, v = random.random((2, len(face), 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    points = a[face] + u * (b - a)[face] + v * (c - a)[face]
    return points[points[:, 2] > 0.3][:count]


def told(points):
    return silhouette(points[:, :2], points[:, 2], fitted_yaw(points[:, :2]))


def of_class(name, least_m=0.0):
    return [one for one in asset_names(name) if asset(one).height > least_m]


def test_riders_and_people_are_told_from_every_side_but_ends():
    random = np.random.default_rng(3)
    # From the front or the rear one who rides is as short as one who walks.
    flanks = [side for side in SIDES if abs(np.sin(side)) > 0.5]
    # Who stands on a scooter walks by its outline; a cargo bicycle is longer before its rider.
    usual = [one for one in of_class("bicycle") if "cargo" not in one and "scooter" not in one]
    riders = [told(side_seen(one, a, random)) for one in usual for a in flanks]
    walkers = [
        told(side_seen(one, a, random)) for one in of_class("pedestrian", 1.4) for a in SIDES
    ]
    assert riders.count("bicycle") > 0.8 * len(riders)
    assert walkers.count("pedestrian") > 0.8 * len(walkers)
    assert walkers.count("bicycle") == 0


def test_parts_of_cars_are_nobody():
    random = np.random.default_rng(4)
    cars = [told(side_seen(one, a, random)) for one in of_class("car") for a in SIDES]
    assert set(cars) == {None}


@pytest.mark.parametrize(("kind", "aside_m"), [("pedestrian", 0.8), ("bicycle", 1.0)])
def test_two_side_by_side_are_two(kind, aside_m):
    random = np.random.default_rng(5)
    right = 0
    for name in of_class(kind, 1.4):
        one, other = (side_seen(name, np.radians(60.0), random) for _ in range(2))
        both = np.vstack([one, other + [0.0, aside_m, 0.0]])
        parts = apart(both[:, :2], both[:, 2])
        if len(parts) == 2:
            whose = [set((part >= len(one)).tolist()) for part in parts]
            right += (
                all(len(each) == 1 for each in whose)
                or min(np.mean(part >= len(one)) for part in parts) < 0.1
            )
    assert right > 0.8 * len(of_class(kind, 1.4))


def test_one_is_not_taken_apart_and_a_car_is_no_group():
    random = np.random.default_rng(6)
    for kind in ("pedestrian", "bicycle", "car"):
        alone = [side_seen(name, 0.9, random) for name in of_class(kind)]
        assert not any(apart(points[:, :2], points[:, 2]) for points in alone)


def moments_of(name, places, shape):
    random = np.random.default_rng(7)
    found = []
    for k, xy in enumerate(places):
        points = side_seen(name, np.radians(70.0), random) + [*xy, 0.0]
        plan, top = points[:, :2], float(points[:, 2].max())
        yaw = fitted_yaw(plan)
        sensor = np.array([0.0, 60.0])
        found.append(SeenObject(k, plan, top, top, 0.3, sensor, 1.0, yaw, None, shape))
    return found


def test_a_slow_rider_is_one_by_its_outline():
    # A walk's pace, and no longer in sight than a long stride.
    moments = moments_of("pedestrian-man", [(1.2 * k, 0.0) for k in range(4)], "bicycle")
    assert observed_track(moments, None, SECONDS.time_s).actor_class == "bicycle"
    moments = moments_of("pedestrian-man", [(1.2 * k, 0.0) for k in range(4)], "pedestrian")
    assert observed_track(moments, None, SECONDS.time_s).actor_class == "pedestrian"


def test_nobody_gets_off_and_walks_on_within_a_frame():
    rides = moments_of("bicycle-city", [(0.0, 0.0)], "bicycle")[0]
    near, far = (
        moments_of("pedestrian-man", [(0.0, 0.0), (along, 0.0)], "pedestrian")[1]
        for along in (0.5, 1.9)
    )
    assert len(tracks_of([[rides], [near]], SECONDS)) == 1  # in part hidden, maybe
    assert len(tracks_of([[rides], [far]], SECONDS)) == 2
