"""Displacements of conflicting paths: rounds of the alternating direction method."""

import numpy as np
from numba import njit

from urbantwin.traffic.compiled import per_actor

__all__ = ["displaced"]


@njit(cache=True, nogil=True)
def displaced(moved, sides, slope, short, factor, weight, rounds):
    """Return displacements (N, 2) nearer to those with which pairs are apart.

    In each round every pair is separated individually, and every path is fitted to the results, by
    its stiffness (see `paths.separation`).

    Args:
        moved: (N, 2) current displacements.
        sides: (P, 2) int64, the rows of both of each pair, N for a fixed object.
        slope: (P, 2, 2) change of a pair's distance with the displacements of both.
        short: (P,) required change of the distance, from zero displacements.
        factor: (3, N) Cholesky factor of the paths' matrix with ``weight`` for each pair: upper
            banded form.
        weight: weight of the pairs relative to the paths.
        rounds: number of rounds.
    """
    count, pairs = len(moved), len(sides)
    solution, right = np.zeros((count + 1, 2)), np.zeros((count + 1, 2))
    for n in range(count):
        solution[n, 0], solution[n, 1] = moved[n, 0], moved[n, 1]
    size, dual = np.empty(pairs), np.zeros((pairs, 2, 2))
    for p in range(pairs):
        size[p] = max(_product(slope, slope, p), 1e-6)
    wanted = np.empty((pairs, 2, 2))
    for _ in range(rounds):
        right[:] = 0.0
        for p in range(pairs):
            for s in range(2):
                for k in range(2):
                    wanted[p, s, k] = solution[sides[p, s], k] + dual[p, s, k]
            lack = max(short[p] - _product(slope, wanted, p), 0.0) / size[p]
            for s in range(2):
                for k in range(2):
                    target = wanted[p, s, k] + lack * slope[p, s, k]
                    dual[p, s, k] = wanted[p, s, k] - target
                    right[sides[p, s], k] += target - dual[p, s, k]
        for n in range(count):
            solution[n, 0], solution[n, 1] = weight * right[n, 0], weight * right[n, 1]
        _solve(factor, solution)
    return solution[:count]


@per_actor
def _product(ones, others, p):
    """Return the sum of the products of two arrays' values (2, 2) of a pair."""
    return (
        ones[p, 0, 0] * others[p, 0, 0]
        + ones[p, 0, 1] * others[p, 0, 1]
        + ones[p, 1, 0] * others[p, 1, 0]
        + ones[p, 1, 1] * others[p, 1, 1]
    )


@per_actor
def _solve(factor, here):
    """Replace right sides, the first rows of ``here``, by the solutions.

    Like LAPACK's ``pbtrs``, which takes ten times as long for three diagonals and single right
    sides.
    """
    count = factor.shape[1]
    for n in range(count):
        for k in range(2):
            solved = 0.0
            if n > 1:
                solved += factor[0, n] * here[n - 2, k]
            if n > 0:
                solved += factor[1, n] * here[n - 1, k]
            here[n, k] = (here[n, k] - solved) / factor[2, n]
    for n in range(count - 1, -1, -1):
        for k in range(2):
            here[n, k] /= factor[2, n]
            if n > 1:
                here[n - 2, k] -= here[n, k] * factor[0, n]
            if n > 0:
                here[n - 1, k] -= here[n, k] * factor[1, n]
