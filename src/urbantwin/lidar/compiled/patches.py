"""Spatially correlated reflectivity of ground: noise that depends on the place alone."""

import numpy as np

from urbantwin.geometry.compiled import per_block, per_ray

__all__ = ["add_patches"]


@per_block
def _mixed(x, y, number):
    """Return 16 random bits of a corner: the mixing function of SplitMix64, as in ``Scatter``."""
    key = np.uint64(x) * np.uint64(0x9E3779B97F4A7C15) + np.uint64(y)
    key = key * np.uint64(0x9E3779B97F4A7C15) + np.uint64(number)
    key = (key ^ key >> np.uint64(30)) * np.uint64(0xBF58476D1CE4E5B9)
    key = (key ^ key >> np.uint64(27)) * np.uint64(0x94D049BB133111EB)
    return key >> np.uint64(48)


@per_ray
def add_patches(east, north, number, size_m, sigma, quantiles, out):
    """Add normal noise of standard deviation ``sigma`` that changes over ``size_m``.

    Each corner of a square lattice has a normal number; between them they are mixed linearly, and
    the mixture is divided by its own standard deviation.

    Args:
        east: (N,) float64, site frame.
        north: (N,) float64, site frame.
        number: of the noise: another one is independent.
        size_m: width of the lattice's squares.
        sigma: standard deviation.
        quantiles: (65536,) float32, standard normal number of each draw.
        out: (N,) float64, to add to.
    """
    for i in range(len(east)):
        u, v = east[i] / size_m, north[i] / size_m
        column, row = np.floor(u), np.floor(v)
        across, up = u - column, v - row
        x, y = np.int64(column), np.int64(row)
        a, b = (1.0 - across) * (1.0 - up), across * (1.0 - up)
        c, d = (1.0 - across) * up, across * up
        total = a * quantiles[_mixed(x, y, number)] + b * quantiles[_mixed(x + 1, y, number)]
        total += c * quantiles[_mixed(x, y + 1, number)]
        total += d * quantiles[_mixed(x + 1, y + 1, number)]
        out[i] += sigma * total / np.sqrt(a * a + b * b + c * c + d * d)
