"""Static ranges of directions beside what the looks along them were made from."""

import numpy as np
import pytest

from urbantwin.reconstruct.recording.range_modes import range_modes

FRAMES = 60


def modes_of(seen, intensity=None):
    """Return the modes of one direction; 0: the look did not come back."""
    seen = np.asarray(seen, float)
    back = np.flatnonzero(seen)
    light = np.full(len(seen), np.nan) if intensity is None else np.asarray(intensity, float)
    return range_modes(
        np.zeros(len(back), np.int64),
        back,
        seen[back].astype(np.float32),
        light[back].astype(np.float32),
        cells=1,
        frames=len(seen),
    )


def wall(range_m, generator, count=FRAMES):
    return range_m + generator.normal(0, 0.03, count)


@pytest.mark.parametrize("waits", [20, 40, 50])
def test_a_look_beyond_proves_that_what_waited_moved(waits):
    seen = wall(30.0, np.random.default_rng(0))
    seen[:waits] = wall(12.0, np.random.default_rng(1), waits)
    found = modes_of(seen)
    assert found.range_m[0, 0] == pytest.approx(30.0, abs=0.02)
    assert found.share[0].tolist() == [1.0, 0.0, 0.0]
    assert found.looks[0] == FRAMES - waits


def test_what_nobody_ever_looks_past_is_background():
    found = modes_of(wall(12.0, np.random.default_rng(1)))
    assert found.range_m[0, 0] == pytest.approx(12.0, abs=0.02)
    assert found.sigma_m[0, 0] == pytest.approx(0.03, rel=0.3)


def test_a_fence_before_a_house_has_both_ranges_and_their_shares():
    generator = np.random.default_rng(2)
    fence = generator.random(400) < 0.3
    house = ~fence & (generator.random(400) < 0.8)
    seen = np.where(fence, wall(10.0, generator, 400), np.where(house, 25.0, 0.0))
    found = modes_of(seen, np.where(fence, 0.2, 0.6))
    assert found.range_m[0, :2] == pytest.approx([25.0, 10.0], abs=0.02)
    assert found.share[0, :2] == pytest.approx([house.mean(), fence.mean()], abs=1e-6)
    assert found.intensity[0, :2] == pytest.approx([0.6, 0.2], abs=1e-6)


def test_a_surface_that_is_lost_more_often_than_not_stays():
    generator = np.random.default_rng(3)
    back = generator.random(300) < 0.2
    found = modes_of(np.where(back, 80.0, 0.0))
    assert found.range_m[0, 0] == 80.0
    assert found.share[0, 0] == pytest.approx(back.mean())


def test_a_bus_before_the_sky_and_passing_cars_are_no_background():
    bus = np.zeros(FRAMES)
    bus[10:22] = 15.0
    assert modes_of(bus).share.sum() == 0
    cars = wall(30.0, np.random.default_rng(4))
    cars[::7] = 14.0
    found = modes_of(cars)
    assert found.share[0].tolist() == [1.0, 0.0, 0.0]
    assert found.looks[0] == (cars > 20).sum()


def test_directions_do_not_know_each_other():
    cell = np.tile(np.arange(5), FRAMES)
    ranges = np.tile(10.0 * np.arange(1, 6), FRAMES).astype(np.float32)
    number = np.repeat(np.arange(FRAMES), 5)
    found = range_modes(cell, number, ranges, np.full(len(cell), np.nan, "f4"), cells=6, frames=60)
    assert found.range_m[:, 0].tolist() == [10, 20, 30, 40, 50, 0]
