"""Road markings detected in imagery: bright, thin, and white or yellow.

All comparisons are ratios of linear light in the neighbourhood, so that paint in a shadow is paint:
a shadow takes the same share of light from paint and asphalt. Bright and wide areas are not paint:
    a white car, concrete, a sunny gap between shadows.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, label, maximum_filter, minimum_filter

__all__ = ["LINEAR", "DetectedPaint", "paint_in_picture"]

#: Linear light of sRGB bytes (IEC 61966-2-1).
_BYTE = np.arange(256) / 255
LINEAR = np.where(_BYTE <= 0.04045, _BYTE / 12.92, ((_BYTE + 0.055) / 1.055) ** 2.4).astype("f4")
#: Paint is thinner than this, and vehicles are between this and the other, metres.
THIN_M, VEHICLE_M = 0.75, 4.0
#: Ratio of a vehicle's brightness to the surrounding road's, and distance around it without paint
#: but with bonnets and sills, metres.
VEHICLE_RATIO, BESIDE_M = 2.0, 0.8
#: Minimum relative brightness of paint above its asphalt, also in deviations of the noise.
LEAST_RATIO, DEVIATIONS = 0.35, 5.0
#: Shares of paint's usual brightness above asphalt: minimum for a spot of paint, and for its
#: border.
SPOT, BORDER = 0.45, 0.35
#: Smaller spots are specks, square metres.
SPECK_M2 = 0.1
#: Minimum and maximum chroma (share of red, green, blue) of white paint minus asphalt's: in a
#: shadow the light of the sky makes it bluer than sunlit asphalt. Then of yellow paint.
WHITE = (-0.08, -0.04, -0.04), (0.04, 0.04, 0.10)
YELLOW = (-0.02, -0.03, -0.40), (0.22, 0.15, -0.025)
#: Number of rows processed together.
ROWS = 2048


@dataclass(frozen=True, eq=False)
class DetectedPaint:
    """Paint in a picture, (ny, nx) each.

    Attributes:
        paint: True for paint.
        unclear: True where paint is not visible: on vehicles and similar areas.
    """

    paint: NDArray[np.bool_]
    unclear: NDArray[np.bool_]


def paint_in_picture(
    rgb: NDArray[np.uint8], road: NDArray[np.bool_], cell_m: float
) -> DetectedPaint:
    """Find the paint on the road.

    Args:
        rgb: (ny, nx, 3) sRGB.
        road: (ny, nx) True for visible carriageway.
        cell_m: side of a pixel, metres.
    """
    ny, nx = road.shape
    paint, unclear = np.zeros((ny, nx), bool), np.zeros((ny, nx), bool)
    if not road.any():
        return DetectedPaint(paint, unclear)
    asphalt = _asphalt_chroma(rgb, road)
    ratio, colour = np.zeros((ny, nx), np.float32), np.zeros((ny, nx), bool)
    halo = 2 * round(VEHICLE_M / cell_m) + 2
    for rows, around, inner in _strips(ny, halo):
        # Channel by channel: numpy sums long rows much faster than rows of three.
        red, green, blue = (LINEAR[rgb[around][..., k]] for k in range(3))
        above, wide = _above_background((red + green) / 2, road[around], cell_m)
        ratio[rows], unclear[rows] = above[inner], wide[inner]
        colour[rows] = _white_or_yellow(red[inner], green[inner], blue[inner], asphalt)
    values = ratio[road & ~unclear]
    if not len(values):
        return DetectedPaint(paint, unclear)
    usual = float(np.median(values))
    noise = 1.4826 * float(np.median(np.abs(values - usual)))
    least = usual + max(LEAST_RATIO, DEVIATIONS * noise)
    bright = values[values > least]
    if len(bright):
        peak = float(np.percentile(bright, 75)) - usual
        good = road & ~unclear & colour
        border = good & (ratio > max(usual + BORDER * peak, least))
        spot = good & (ratio > max(usual + SPOT * peak, least))
        paint = _with_spots(border, spot, cell_m)
    return DetectedPaint(paint, unclear)


def _strips(rows: int, halo: int) -> Iterator[tuple[slice, slice, slice]]:
    """Yield a strip's rows, these rows with a margin, and the strip's rows within them."""
    for first in range(0, rows, ROWS):
        last = min(first + ROWS, rows)
        low, high = max(0, first - halo), min(rows, last + halo)
        yield slice(first, last), slice(low, high), slice(first - low, last - low)


def _asphalt_chroma(rgb: NDArray[np.uint8], road: NDArray[np.bool_]) -> NDArray[np.float32]:
    places = np.flatnonzero(road.ravel())
    light = LINEAR[rgb.reshape(-1, 3)[places[:: max(1, len(places) // 200_000)]]]
    total = np.maximum(light.sum(axis=1, keepdims=True), np.float32(1e-4))
    return np.asarray(np.median(light / total, axis=0), np.float32)


def _above_background(
    light: NDArray[np.float32], road: NDArray[np.bool_], cell_m: float
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return the relative brightness above the surrounding road, and where vehicles are."""
    thin = _opened(light, road, THIN_M, cell_m)
    wide = _opened(light, road, VEHICLE_M, cell_m)
    dark = np.float32(max(1e-4, 0.2 * float(np.median(light[road])) if road.any() else 1e-4))
    above = np.asarray((light - thin) / np.maximum(thin, dark), np.float32)
    vehicle = road & (thin > VEHICLE_RATIO * np.maximum(wide, dark))
    reach = max(1, round(BESIDE_M / cell_m))
    return above, binary_dilation(vehicle, np.ones((3, 3), bool), iterations=reach)


def _opened(
    light: NDArray[np.float32], road: NDArray[np.bool_], width_m: float, cell_m: float
) -> NDArray[np.float32]:
    """Return the morphological opening of the road's brightness by a width."""
    size = max(3, 2 * round(width_m / cell_m / 2) + 1)
    big = np.float32(1e6)
    low = minimum_filter(np.where(road, light, big), size)
    low[low >= big] = -big
    high = maximum_filter(low, size)
    return np.where(road & (high > -big), high, light)


def _white_or_yellow(
    red: NDArray[np.float32],
    green: NDArray[np.float32],
    blue: NDArray[np.float32],
    asphalt: NDArray[np.float32],
) -> NDArray[np.bool_]:
    total = np.maximum(red + green + blue, np.float32(1e-4))
    white, yellow = np.ones(red.shape, bool), np.ones(red.shape, bool)
    for k, channel in enumerate((red, green, blue)):
        off = channel / total - asphalt[k]
        white &= (off >= np.float32(WHITE[0][k])) & (off <= np.float32(WHITE[1][k]))
        yellow &= (off >= np.float32(YELLOW[0][k])) & (off <= np.float32(YELLOW[1][k]))
    return white | yellow


def _with_spots(
    border: NDArray[np.bool_], spot: NDArray[np.bool_], cell_m: float
) -> NDArray[np.bool_]:
    """Return the pieces of ``border`` that hold a spot and are larger than specks."""
    number, count = label(border, np.ones((3, 3), bool))
    sizes = np.bincount(number.ravel(), minlength=count + 1)
    spots = np.bincount(number[spot], minlength=count + 1)
    keep = (sizes * cell_m**2 >= SPECK_M2) & (spots > 0)
    keep[0] = False
    return np.asarray(keep[number])
