"""Blind sectors and dropout rates of discovered sensors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.reconstruct.recording.beams import Beams

__all__ = ["Losses", "losses_of"]

#: Minimum width of azimuth bins, in degrees and in columns.
_BIN_DEG, _BIN_COLUMNS = 1.0, 2
#: Share of the bins with returns from which a ring counts as complete.
_WHOLE = 0.85
#: Maximum median range of such a ring, metres: its gaps are due to neither range limit nor
#: cropping.
_NEAR_M = 25.0
#: A sector is blind if this many rings lack it over this many degrees, with ends that agree within
#: the last value, degrees.
_LEAST_RINGS, _LEAST_DEG, _ALIKE_DEG = 4, 3.0, 3.0
#: Share of the complete rings from which a sector is attributed to all channels.
_ALL = 0.9
#: Smaller dropout rates are not written.
_LEAST_MISSING = 0.005


@dataclass(frozen=True)
class Losses:
    """Returns that a sensor's recording lacks, compared with its model.

    Attributes:
        sectors: (first, last) azimuth in the sensor frame at a yaw of 0, degrees counter-clockwise,
            and the channels, empty for all.
        missing: share of beams at near ground without a return.
    """

    sectors: tuple[tuple[float, float, tuple[int, ...]], ...]
    missing: float

    def written(self) -> dict[str, Any]:
        """Return them as fields of a sensor in a rig file."""
        rows: list[dict[str, Any]] = []
        for first, last, channels in self.sectors:
            only = {"channels": list(channels)} if channels else {}
            rows.append({"sector_deg": [first, last], **only})
        told: dict[str, Any] = {"outages": rows} if rows else {}
        if self.missing >= _LEAST_MISSING:
            told["calibration"] = {"missing": self.missing}
        return told


def losses_of(beams: Beams, counted: NDArray[np.float64], columns: int) -> Losses:
    """Return the blind sectors of a sensor, and its dropout rate elsewhere.

    Rings with returns from nearly all directions lie on the ground. A sector that several of them
    lack in every frame is hidden by something at the sensor: a mast, or its own housing.

    Args:
        beams: beams that returned in any frame.
        counted: (C,) mean number of points per frame of each channel.
        columns: columns per rotation of the model.
    """
    wide = max(_BIN_DEG, _BIN_COLUMNS * float(np.degrees(beams.column_rad)))
    bins = int(360 / wide)
    wide = 360 / bins
    at = np.floor(np.degrees(beams.azimuth) / wide).astype(int) % bins
    channels, row = np.unique(beams.channel, return_inverse=True)
    seen = np.zeros((len(channels), bins), bool)
    seen[row, at] = True
    far = np.where(beams.range_m[:, 0] > 0, beams.range_m[:, 0], np.inf)
    near = np.array([np.median(far[row == n]) for n in range(len(channels))]) < _NEAR_M
    whole = np.flatnonzero((seen.mean(axis=1) >= _WHOLE) & near)
    runs = [(first, last, int(n)) for n in whole for first, last in _gaps(seen[n], wide)]
    sectors = []
    while runs:
        alike = [one for one in runs if _apart(one, runs[0]) <= _ALIKE_DEG / wide]
        runs = [one for one in runs if one not in alike]
        if len(alike) < _LEAST_RINGS:
            continue
        low, high = (int(np.median([one[end] for one in alike])) for end in (0, 1))
        every = len(alike) >= _ALL * len(whole)
        rings = () if every else tuple(sorted(int(channels[n]) for _, _, n in alike))
        sectors.append((_degrees(low * wide), _degrees(high * wide), rings))
    lost = 1 - counted[channels[whole]] / (columns * seen[whole].mean(axis=1))
    missing = float(np.median(lost)) if len(whole) else 0.0
    return Losses(tuple(sorted(sectors)), round(max(missing, 0.0), 3))


def _gaps(seen: NDArray[np.bool_], wide: float) -> list[tuple[int, int]]:
    """Return the gaps (first, past the last) of a ring in bins; numbers continue past the seam."""
    start = int(np.flatnonzero(seen)[0])
    turned = np.roll(seen, -start)
    edges = np.diff(np.concatenate([[1], turned.astype(np.int8), [1]]))
    first, last = np.flatnonzero(edges < 0) + start, np.flatnonzero(edges > 0) + start
    long = last - first >= _LEAST_DEG / wide
    return list(zip(first[long].tolist(), last[long].tolist(), strict=True))


def _apart(one: tuple[int, int, int], other: tuple[int, int, int]) -> int:
    return max(abs(one[0] - other[0]), abs(one[1] - other[1]))


def _degrees(around: float) -> float:
    """Return an azimuth from -180 to 180, to a tenth of a degree."""
    return round((around + 180.0) % 360.0 - 180.0, 1)
