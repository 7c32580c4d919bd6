"""Light in pictures of the twin: the sky, diffuse directions at a surface, screen tones."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

__all__ = ["HORIZON", "SAMPLES", "scattered_about", "sky", "smoothed", "toned"]

#: Sub-pixels along each side of a pixel.
SAMPLES = 2
_ZENITH = np.array([0.24, 0.42, 0.66], np.float32)
HORIZON = np.array([0.80, 0.86, 0.91], np.float32)


def scattered_about(normal: NDArray[np.float32], seed: int) -> NDArray[np.float32]:
    """Return one direction (N, 3) around each normal, as a matt surface scatters light.

    A point on the unit sphere around the end of the normal gives such a direction
    (cosine-weighted).
    """
    generator = np.random.Generator(np.random.Philox(key=seed))
    z = generator.random(len(normal), np.float32) * 2 - 1
    turn = generator.random(len(normal), np.float32) * np.float32(2 * np.pi)
    flat = np.sqrt(1 - z * z) * np.float32(0.999)
    out = normal.copy()
    out[:, 0] += flat * np.cos(turn)
    out[:, 1] += flat * np.sin(turn)
    out[:, 2] += z * np.float32(0.999)
    out /= np.sqrt(np.einsum("ij,ij->i", out, out))[:, None]
    return out


def smoothed(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Average noisy values over neighbouring sub-pixels that hit something."""
    known = np.isfinite(values)
    size = 7 * SAMPLES + 1
    total = uniform_filter(np.where(known, values, np.float32(0)), size)
    share = uniform_filter(known.astype(np.float32), size)
    out = np.divide(total, share, out=np.ones_like(total), where=share > 1e-6)
    return np.asarray(out, np.float32)


def sky(z: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the sky's colour (N, 3) for directions with z component ``z``, linear light."""
    share = np.sqrt(np.clip((z + np.float32(0.05)) * 2, 0, 1))[:, None]
    return np.asarray(HORIZON * (1 - share) + _ZENITH * share, np.float32)


def toned(colour: NDArray[np.float32]) -> NDArray[np.float32]:
    """Compress highlights and encode for a screen (colours above are linear light)."""
    bright = colour * np.float32(1.2)
    return np.asarray(np.sqrt(bright / (1 + np.float32(0.18) * bright)))
