"""Places that a twin lacks: rays of a made sensor on a plane, and a block of known place on it."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from urbantwin.fidelity.missing import CELL_M, MissingPlaces, without_surface

#: The sensor stands here; the ground is z = 0.
ORIGIN = np.array([3.0, -2.0, 5.0])
#: Low and high corners of the block that the twin lacks.
BLOCK = np.array([[18.5, 9.0, 0.0], [21.5, 11.0, 3.0]])


def scan(tilt_deg=0.0, block=None, wall_at=None):
    """Return what 64 rings of 900 beams meet: ground up to 90 m, and what stands on it.

    Args:
        tilt_deg: the sensor's pitch.
        block: (2, 3) corners of an upright box.
        wall_at: a wall of 6 m height across the street at this x.
    """
    elevation, azimuth = np.meshgrid(
        np.radians(np.linspace(-24, 6, 64) - tilt_deg), np.radians(np.arange(0, 360, 0.4))
    )
    way = np.column_stack(
        [
            (np.cos(elevation) * np.cos(azimuth)).ravel(),
            (np.cos(elevation) * np.sin(azimuth)).ravel(),
            np.sin(elevation).ravel(),
        ]
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        away = np.where(way[:, 2] < 0, -ORIGIN[2] / way[:, 2], np.inf)
        if wall_at is not None:
            wall = (wall_at - ORIGIN[0]) / way[:, 0]
            high = ORIGIN[2] + wall * way[:, 2]
            away = np.where((wall > 0) & (high > 0) & (high < 6) & (wall < away), wall, away)
        on_block = np.zeros(len(way), bool)
        if block is not None:  # slabs (Kay and Kajiya 1986)
            ends = (block[:, None] - ORIGIN) / way
            enter, leave = ends.min(axis=0).max(axis=1), ends.max(axis=0).min(axis=1)
            on_block = (enter < leave) & (enter > 0) & (enter < away)
            away = np.where(on_block, enter, away)
    seen = away < 90.0
    return ORIGIN + away[seen, None] * way[seen], on_block[seen]


def lost_in(real, twin, **known):
    away = cKDTree(twin).query(real)[0]
    return without_surface(real, away, ORIGIN, twin=twin, **known)


def test_a_block_that_the_twin_lacks_is_first_and_its_points_are_counted():
    real, on_block = scan(block=BLOCK, wall_at=40.0)
    twin, _ = scan(wall_at=40.0)
    lost = lost_in(real, twin)
    # Every point higher than half a metre above the ground, and none that is not the block's.
    high = on_block & (real[:, 2] > 0.55)
    assert len(lost) == pytest.approx(high.sum(), abs=0.05 * high.sum())
    assert high.sum() > 100
    gathered = MissingPlaces()
    for _ in range(3):
        gathered.add(lost)
    places = gathered.places()
    middle = BLOCK.mean(axis=0)
    assert abs(places[0]["x"] - middle[0]) < CELL_M
    assert abs(places[0]["y"] - middle[1]) < CELL_M
    assert 0.4 < places[0]["low"] < places[0]["high"] <= 3.0
    assert sum(place["points_per_frame"] for place in places) == pytest.approx(len(lost))
    counts = [place["points_per_frame"] for place in places]
    assert counts == sorted(counts, reverse=True)


def test_far_ground_between_rings_is_not_missing():
    real, _ = scan()
    twin, _ = scan(tilt_deg=0.23)  # half a ring's step: rings of either lie between the other's
    away = cKDTree(twin).query(real)[0]
    # Without looking between rings hundreds of points of bare ground would be called missing.
    assert len(without_surface(real, away, ORIGIN)) > 500
    assert len(lost_in(real, twin)) < 0.005 * len(real)


def test_ground_that_the_twin_ends_before_is_missing():
    real, _ = scan()
    twin, _ = scan()
    twin = twin[twin[:, 0] < 20]
    lost = lost_in(real, twin)
    assert len(lost)
    assert (lost[:, 0] > 20).all()
    gone = real[(real[:, 0] > 25) & (real[:, 0] < 40)]
    found = lost[(lost[:, 0] > 25) & (lost[:, 0] < 40)]
    assert len(found) > 0.9 * len(gone)


def test_a_wall_behind_does_not_stand_in_for_one_in_front():
    real, _ = scan(wall_at=30.0)
    twin, _ = scan(wall_at=34.0)
    lost = lost_in(real, twin)
    on_wall = (np.abs(real[:, 0] - 30) < 1e-6) & (real[:, 2] > 1.5) & (real[:, 2] < 4.5)
    near = np.abs(real[:, 1]) < 25
    found = (np.abs(lost[:, 0] - 30) < 1e-6) & (lost[:, 2] > 1.5) & (lost[:, 2] < 4.5)
    found &= np.abs(lost[:, 1]) < 25
    assert found.sum() > 0.95 * (on_wall & near).sum()


def test_actors_are_left_out_and_few_points_do_not_fail():
    real, on_block = scan(block=BLOCK)
    twin, _ = scan()
    assert len(lost_in(real, twin, actor=on_block)) < 0.02 * on_block.sum()
    assert len(lost_in(real[:1], twin[:1])) == 0
    assert len(lost_in(real[:1], twin[:1] + 50.0)) == 1
    assert MissingPlaces().places() == []
