"""Several sources of the ground as one elevation."""

import numpy as np
import pytest
import shapely

from urbantwin.errors import InputError
from urbantwin.ground import ElevationPatch, merged_elevation

REGION = shapely.box(-40, -30, 40, 30)


def patch(function, bounds, step, name, detail=None):
    west, south, east, north = bounds
    x, y = np.meshgrid(
        np.arange(west, east + step / 2, step), np.arange(south, north + step / 2, step)
    )
    return ElevationPatch(west, south, step, function(x, y), detail or step, name)


def plane(x, y):
    return 0.03 * x - 0.05 * y + 1.0


def points(count, bounds, seed=1):
    west, south, east, north = bounds
    return np.random.default_rng(seed).uniform([west, south], [east, north], (count, 2))


def test_one_plane_seen_by_two_sources_stays_that_plane():
    sources = [
        patch(plane, (-60, -60, 60, 60), 5.0, "coarse"),
        patch(plane, (-17, -11, 13, 9), 0.5, "fine"),
    ]
    elevation, shares = merged_elevation(sources, REGION)
    at = points(500, REGION.bounds)
    assert np.abs(elevation.raw_at(at) - plane(*at.T)).max() < 1e-9
    assert shares == {"coarse": 1.0, "fine": pytest.approx(30 * 20 / (80 * 60), abs=0.02)}
    assert elevation.detail == 0.5


def test_the_finer_source_counts_whatever_the_order_and_meets_the_coarser_without_a_step():
    high = patch(lambda x, y: plane(x, y) + 0.6, (-20, -20, 20, 20), 0.5, "fine")
    low = patch(plane, (-60, -60, 60, 60), 2.0, "coarse")
    first, _ = merged_elevation([high, low], REGION)
    second, _ = merged_elevation([low, high], REGION)
    assert np.array_equal(first.raw, second.raw)
    inner = points(200, (-15, -15, 15, 15))
    assert np.abs(first.raw_at(inner) - plane(*inner.T) - 0.6).max() < 1e-6
    outer = points(200, (21, -30, 40, 30))
    assert np.abs(first.raw_at(outer) - plane(*outer.T)).max() < 1e-9
    along = np.column_stack([np.arange(0, 40, 0.25), np.zeros(160)])
    assert np.abs(np.diff(first.raw_at(along))).max() < 0.06  # 0.6 m over 4 m, not at once


def test_holes_are_filled_from_their_rims():
    def with_hole(x, y):
        return np.where((np.abs(x) < 8) & (np.abs(y) < 6), np.nan, plane(x, y))

    elevation, _ = merged_elevation([patch(with_hole, (-60, -60, 60, 60), 0.5, "scan")], REGION)
    at = points(300, (-8, -6, 8, 6))
    # no better than its rim, and no worse: within the span of the plane over the hole
    assert np.abs(elevation.raw_at(at) - plane(*at.T)).max() < 0.3
    assert np.isfinite(elevation.raw).all()


def test_a_source_elsewhere_is_refused():
    with pytest.raises(InputError, match=r"far\.laz: no height of the ground within the region"):
        merged_elevation([patch(plane, (500, 500, 520, 520), 1.0, "far.laz")], REGION)
