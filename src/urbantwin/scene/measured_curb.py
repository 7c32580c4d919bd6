"""How high footways and islands lie above the carriageway, where that was measured."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.scene.zones import Zone

__all__ = ["with_measured_curbs"]

#: Heights are compared so far apart, metres, and at so many places at least.
_STEP_M, _FEWEST = 0.5, 20
#: No curb is lower or higher, metres.
_LOWEST_M, _HIGHEST_M = 0.01, 0.3

_Heights = Callable[[NDArray[np.float64]], NDArray[np.float64]]


def with_measured_curbs(
    zones: Sequence[Zone],
    measured: shapely.Geometry,
    road_height: _Heights,
    ground_height: _Heights,
) -> list[Zone]:
    """Return zones whose raised pieces are as high above the carriageway as they were measured.

    The median over each piece of what was measured above the road's height beside it; pieces that
    were not measured keep the usual curb.

    Args:
        zones: what lies where.
        measured: where the ground was measured from close by.
        road_height: of the carriageway and, beside it, of its surface led on, at (N, 2) points.
        ground_height: of what was measured, at (N, 2) points.
    """
    found: list[Zone] = []
    shapely.prepare(measured)
    for zone in zones:
        if not zone.step or not shapely.intersects(measured, zone.area):
            found.append(zone)
            continue
        for piece in shapely.get_parts(zone.area):
            low, high = np.reshape(piece.bounds, (2, 2))
            axes = [np.arange(a + _STEP_M / 2, b, _STEP_M) for a, b in zip(low, high, strict=True)]
            at = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
            at = at[shapely.contains_xy(piece, *at.T)]
            at = at[shapely.contains_xy(measured, *at.T)]
            above = ground_height(at) - road_height(at) if len(at) else np.zeros(0)
            above = above[np.isfinite(above)]
            step = None
            if len(above) >= _FEWEST:
                step = float(np.clip(np.median(above), _LOWEST_M, _HIGHEST_M))
            found.append(replace(zone, area=piece, measured_step_m=step))
    return found
