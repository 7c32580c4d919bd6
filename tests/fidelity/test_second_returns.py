"""Whether firings have two returns, of turns that are made with and without."""

import numpy as np
import pytest

from urbantwin.fidelity.discovery.discover import reports_two
from urbantwin.fidelity.discovery.point_rays import PointRays

PLACE, STEP = np.array([3.0, -2.0, 1.5]), np.radians(0.2)


def frame(second, wrong=0.0, seed=0):
    """A frame of 8 rings: some firings go past an edge, and return from what is behind as well."""
    rng = np.random.default_rng(seed)
    ring, column = (grid.ravel() for grid in np.mgrid[:8, :1800])
    azimuth = column * STEP
    range_m = 12.0 + 0.4 * np.cos(3 * azimuth)
    edge = rng.random(len(ring)) < second
    ring, azimuth = (np.concatenate([one, one[edge]]) for one in (ring, azimuth))
    range_m = np.concatenate([range_m, range_m[edge] + rng.uniform(1, 20, int(edge.sum()))])
    stray = rng.random(len(ring)) < wrong  # points of other rings, anywhere on this one
    azimuth, range_m = (
        np.where(stray, rng.uniform(0, 6.28, len(ring)), azimuth),
        range_m + 9 * stray,
    )
    up = np.radians(-8.0 + ring)
    ways = np.column_stack([np.cos(up) * np.cos(azimuth), np.cos(up) * np.sin(azimuth), np.sin(up)])
    none = np.zeros(len(ring))
    return PLACE + ways * range_m[:, None], PointRays(none.astype(int), ring, none, azimuth, none)


@pytest.mark.parametrize(
    ("second", "wrong", "two"),
    [(0.0, 0.0, False), (0.0, 0.05, False), (0.01, 0.0, True), (0.04, 0.02, True)],
)
def test_second_returns_are_told_from_points_on_wrong_rings(second, wrong, two):
    points, rays = zip(*(frame(second, wrong, seed) for seed in range(3)), strict=True)
    assert reports_two(points, rays, 0, PLACE, STEP) == two
    assert not reports_two(points, rays, 1, PLACE, STEP)  # that sensor has no points
