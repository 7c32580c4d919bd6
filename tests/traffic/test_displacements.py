"""Displacements of paths: LAPACK finds the same."""

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded

from urbantwin.traffic.compiled.displacements import displaced

ROWS, PAIRS, WEIGHT, ROUNDS = 300, 500, 8.0, 40


def test_lapack_finds_the_same_displacements() -> None:
    rng = np.random.default_rng(4)
    sides = rng.integers(0, ROWS + 1, (PAIRS, 2))  # the last is who stays
    slope = rng.normal(size=(PAIRS, 2, 2))
    short = np.where(rng.random(PAIRS) < 0.2, -np.inf, rng.normal(size=PAIRS))
    moved = rng.normal(size=(ROWS, 2))
    times = np.bincount(sides.ravel(), minlength=ROWS + 1)[:ROWS]
    band = np.zeros((3, ROWS))
    band[2] = 1.0 + 6.0 * 15.0**4 + WEIGHT * times
    band[1, 1:], band[0, 2:] = -4.0 * 15.0**4 * 0.7, 15.0**4 * 0.7
    factor = cholesky_banded(band)

    here, dual = np.concatenate([moved, np.zeros((1, 2))]), np.zeros((PAIRS, 2, 2))
    size = np.maximum((slope**2).sum(axis=(1, 2)), 1e-6)
    for _ in range(ROUNDS):
        wanted = here[sides] + dual
        lack = np.maximum(short - (slope * wanted).sum(axis=(1, 2)), 0.0)
        there = wanted + (lack / size)[:, None, None] * slope
        dual = wanted - there
        pull = np.zeros((ROWS + 1, 2))
        np.add.at(pull, sides.ravel(), (there - dual).reshape(-1, 2))
        here[:ROWS] = cho_solve_banded((factor, False), WEIGHT * pull[:ROWS])

    before = moved.copy()
    found = displaced(moved, sides, slope, short, factor, WEIGHT, ROUNDS)
    np.testing.assert_allclose(found, here[:ROWS], rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(moved, before)
