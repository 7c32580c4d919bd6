"""Where sensors are blind, and how many of their looks are lost: what the recording lacks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.reconstruct.recording.beams import Beams

__all__ = ["Losses", "losses_of"]

#: Azimuth is looked at in bins of so many degrees, of two columns at least.
_BIN_DEG, _BIN_COLUMNS = 1.0, 2
#: A ring that comes back from this share of the bins does so wherever nothing hides it.
_WHOLE = 0.85
#: And lies so near, metres: what it lacks is not beyond the sensor's reach, or cropped.
_NEAR_M = 25.0
#: A sector is blind that so many rings lack, over so many degrees; two rings lack the same one if
#: its ends are as near as this.
_LEAST_RINGS, _LEAST_DEG, _ALIKE_DEG = 4, 3.0, 3.0
#: Of so many of the rings that come back all round, all channels are said to be blind.
_ALL = 0.9
#: A smaller share of lost looks is not written.
_LEAST_MISSING = 0.005


@dataclass(frozen=True)
class Losses:
    """What a sensor's recording lacks that its model would have.

    Attributes:
        sectors: (first, last) azimuth in its frame at a yaw of 0, degrees counter-clockwise, and
            the channels, none for all.
        missing: share of the looks at near ground that never came back.
    """

    sectors: tuple[tuple[float, float, tuple[int, ...]], ...]
    missing: float

    def written(self) -> dict[str, Any]:
        """Return them as fields of a sensor in a rig."""
        rows: list[dict[str, Any]] = []
        for first, last, channels in self.sectors:
            only = {"channels": list(channels)} if channels else {}
            rows.append({"sector_deg": [first, last], **only})
        told: dict[str, Any] = {"outages": rows} if rows else {}
        if self.missing >= _LEAST_MISSING:
            told["calibration"] = {"missing": self.missing}
        return told


def losses_of(beams: Beams, counted: NDArray[np.float64], columns: int) -> Losses:
    """Return where a sensor is blind, and which share of its other looks is lost.

    Rings that come back from nearly all round lie on the ground. What several of them lack in the
    same sector, in every frame, is hidden by something at the sensor: a mast, its own housing.

    Args:
        beams: what came back in any frame.
        counted: (C,) points per frame of each channel, on the mean.
        columns: that the model has per turn.
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
    """Return runs (first, past the last) of bins that a ring lacks; past the seam numbers go on."""
    start = int(np.flatnonzero(seen)[0])
    turned = np.roll(seen, -start)
    edges = np.diff(np.concatenate([[1], turned.astype(np.int8), [1]]))
    first, last = np.flatnonzero(edges < 0) + start, np.flatnonzero(edges > 0) + start
    long = last - first >= _LEAST_DEG / wide
    return list(zip(first[long].tolist(), last[long].tolist(), strict=True))


def _apart(one: tuple[int, int, int], other: tuple[int, int, int]) -> int:
    return max(abs(one[0] - other[0]), abs(one[1] - other[1]))


def _degrees(around: float) -> float:
    """Return an azimuth of -180 to 180, to a tenth of a degree."""
    return round((around + 180.0) % 360.0 - 180.0, 1)
