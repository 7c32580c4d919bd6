"""Columns of points on a ring, against turns whose firings are known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from urbantwin.fidelity.column_assignment import columns_apart


@pytest.mark.parametrize("phase", [0.0, 0.31, 0.5, 0.77])
def test_an_uneven_turn_has_one_firing_in_nearly_every_column(phase):
    rng = np.random.default_rng(7)
    columns = 900
    at = np.arange(columns) + phase + rng.normal(0, 0.15, columns)
    ring = np.zeros(columns, np.int64)
    nearest = len(np.unique(np.rint(at) % columns))
    found = columns_apart(ring, at, columns)
    assert len(np.unique(found)) >= columns - 1
    assert phase != 0.5 or nearest < 0.85 * columns  # what is mended
    off = (found - at + columns / 2) % columns - columns / 2
    assert np.abs(off).max() <= 1.0


@given(
    st.lists(st.tuples(st.integers(0, 3), st.floats(-50, 150)), max_size=60),
    st.integers(20, 90),
)
def test_no_firing_goes_far_and_none_passes_another(points, columns):
    ring = np.array([one for one, _ in points], np.int64)
    at = np.array([where for _, where in points], np.float64)
    found = columns_apart(ring, at, columns)
    off = (found - at + columns / 2) % columns - columns / 2
    assert (np.abs(off) <= 1.0 + 1e-9).all()
    assert ((found >= 0) & (found < columns)).all()
    alone = [
        len(np.unique(side[ring == one]))
        for one in range(4)
        for side in (found, np.rint(at) % columns)
    ]
    assert all(now >= before for now, before in zip(alone[::2], alone[1::2], strict=True))


def test_returns_of_one_firing_share_its_column():
    at = np.repeat(np.arange(40) + 0.5, 2) + np.tile([0.0, 0.01], 40)
    found = columns_apart(np.zeros(80, np.int64), at, 100).reshape(40, 2)
    np.testing.assert_array_equal(found[:, 0], found[:, 1])
    assert len(np.unique(found)) == 40


def test_points_that_lie_in_columns_stay_there():
    rng = np.random.default_rng(1)
    column, ring = rng.permutation(360)[:200], rng.integers(0, 5, 200)
    np.testing.assert_array_equal(
        columns_apart(ring, column + rng.uniform(-0.4, 0.4, 200), 360), column
    )
