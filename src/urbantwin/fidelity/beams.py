"""Comparison per beam: differences of ranges, and whether the same beams return."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.fidelity.frame import Frame

__all__ = ["AZIMUTH_CELL_DEG", "BeamAgreement", "beam_agreement", "beams_are_known"]

#: Without known columns, beams of a ring are matched in azimuth cells of this width.
AZIMUTH_CELL_DEG = 0.4


@dataclass(frozen=True)
class BeamAgreement:
    """Beams of two frames of one sensor.

    Attributes:
        beams: beams that either frame could have seen: rings with a return, times columns with
            a return.
        matched: beams that returned in both.
        range_error_median_m: median of synthetic less real range; None without a match.
        range_error_abs_median_m: median of its absolute value.
        range_error_abs_p95_m: 95th percentile of its absolute value.
        same_outcome: share of the beams that returned in both frames or in neither, 0..1.
        real_dropout: share of the beams without a return in the real frame, 0..1.
        synthetic_dropout: the same in the synthetic frame.
    """

    beams: int
    matched: int
    range_error_median_m: float | None
    range_error_abs_median_m: float | None
    range_error_abs_p95_m: float | None
    same_outcome: float
    real_dropout: float
    synthetic_dropout: float


def beams_are_known(real: Frame, synthetic: Frame) -> str | None:
    """Return how beams can be matched, by ``column`` or ``azimuth``; None if they cannot be.

    Both frames must have the same number of sensors, and of rings with returns.
    """
    if real.ring is None or synthetic.ring is None or _beams(real) != _beams(synthetic):
        return None
    if real.column is None or synthetic.column is None:
        return "azimuth"
    # columns of different firing rates or numberings do not match
    last = sorted((int(real.column.max()), int(synthetic.column.max())))
    return "column" if last[1] - last[0] <= 0.02 * max(last[1], 1) else "azimuth"


def beam_agreement(real: Frame, synthetic: Frame) -> BeamAgreement | None:
    """Compare two frames of one sensor per beam; None if beams are unknown.

    Rings are sorted by their median elevation per sensor: datasets number them from the top, from
    the bottom or in firing order. A beam is a ring and a column, or a ring and a cell of azimuth
    (of several points in one, the nearest). Rings or columns without a return in either frame are
    not counted.

    Args:
        real: frame with ``ring`` and, if available, ``column`` and ``sensor``.
        synthetic: frame of the same sensor at the same place.
    """
    how = beams_are_known(real, synthetic)
    if how is None:
        return None
    tables = [_ranges(frame, how) for frame in (real, synthetic)]
    rows = np.unique(np.concatenate([table[0] for table in tables]))
    columns = np.unique(np.concatenate([table[1] for table in tables]))
    grids = []
    for row, column, distance in tables:
        grid = np.full((len(rows), len(columns)), np.inf)
        place = np.searchsorted(rows, row), np.searchsorted(columns, column)
        np.minimum.at(grid, place, distance)
        grids.append(grid)
    returned = [np.isfinite(grid) for grid in grids]
    both = returned[0] & returned[1]
    error = grids[1][both] - grids[0][both]
    some = len(error) > 0
    return BeamAgreement(
        beams=grids[0].size,
        matched=len(error),
        range_error_median_m=float(np.median(error)) if some else None,
        range_error_abs_median_m=float(np.median(np.abs(error))) if some else None,
        range_error_abs_p95_m=float(np.percentile(np.abs(error), 95)) if some else None,
        same_outcome=float((returned[0] == returned[1]).mean()),
        real_dropout=float(1 - returned[0].mean()),
        synthetic_dropout=float(1 - returned[1].mean()),
    )


def _beams(frame: Frame) -> list[int]:
    """Return the number of rings of each sensor."""
    if frame.ring is None:
        return []
    sensor = _sensor(frame)
    return [len(np.unique(frame.ring[sensor == one])) for one in np.unique(sensor)]


def _sensor(frame: Frame) -> NDArray[np.int64]:
    return np.zeros(len(frame.points), np.int64) if frame.sensor is None else frame.sensor


def _ranges(
    frame: Frame, how: str
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Return the row (sensor and ring), the column and the range of every point."""
    sensor = _sensor(frame)
    places = frame.sensor_places
    seen = frame.points - places[np.minimum(sensor, len(places) - 1)]
    column = frame.column
    if how == "azimuth" or column is None:
        turn = np.degrees(np.arctan2(seen[:, 1], seen[:, 0])) % 360.0
        column = np.floor(turn / AZIMUTH_CELL_DEG).astype(np.int64)
    elevation = np.arctan2(seen[:, 2], np.hypot(seen[:, 0], seen[:, 1]))
    row = np.zeros(len(seen), np.int64)
    for number, one in enumerate(np.unique(sensor)):
        mine = np.flatnonzero(sensor == one)
        row[mine] = number * 65_536 + _ranked(frame.ring, mine, elevation)
    return row, column.astype(np.int64), np.linalg.norm(seen, axis=1)


def _ranked(
    ring: NDArray[np.int64] | None, mine: NDArray[np.intp], elevation: NDArray[np.float64]
) -> NDArray[np.int64]:
    """Return the place of each point's ring in the order of the rings' median elevations."""
    if ring is None:
        raise ValueError("the frame has no rings")
    _, place = np.unique(ring[mine], return_inverse=True)
    medians = [np.median(elevation[mine[place == k]]) for k in range(int(place.max()) + 1)]
    rank = np.empty(len(medians), np.int64)
    rank[np.argsort(medians, kind="stable")] = np.arange(len(medians))
    return np.asarray(rank[place])
