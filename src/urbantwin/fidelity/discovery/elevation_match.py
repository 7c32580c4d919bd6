"""Match of a sensor's rings to the elevations of models, and the sensor's pose from them.

Pieces of rings lie at the elevations of a sensor's channels. A table of elevations determines the
height, which rings on level ground alone do not. The table is fitted together with position, axis,
and the offsets by which this unit differs from its model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks
from scipy.special import gammaln

from urbantwin.fidelity.discovery.ring_pieces import RingPieces
from urbantwin.fidelity.discovery.standpoint import Standpoint, ring_residuals
from urbantwin.fidelity.discovery.unit import OnChannel, Unit
from urbantwin.fidelity.discovery.unit_fit import Belief, Freedom, fit_unit
from urbantwin.lidar import Sensor

__all__ = [
    "TableFit",
    "channel_likelihood_ratio",
    "fit_alike",
    "fit_free_table",
    "fit_tables",
    "normal_density",
]

#: Pieces overlap: this many count as one independent observation of a ring.
_PIECES_PER_LOOK = 8.0
#: Priors of a unit's elevation offsets: for most models (Ouster and HDL-64E units differ by 0.1
#: degrees, others by less), for a model similar to a free table, and for a free table.
_OF_MODEL, _OF_ODD_UNIT, _OF_NOBODY = Freedom(0.12), Freedom(0.3), Freedom(2.0)
#: A free table is similar to a model's if they differ by less than this share of the mean channel
#: spacing, and if it has at least this many channels.
_ALIKE, _FEWEST_ALIKE = 0.8, 12
#: Tolerances from coarse to fine, and the standard deviation of elevations on a ring, degrees.
_FINER_DEG, _RING_DEG = (0.15, 0.08, 0.05, 0.03), 0.04
#: Share of the pieces on rings, and the span of elevations of the others, degrees.
_ON, _OTHERS_DEG = 0.9, 100.0
#: Range and step of tested heights, metres; bin size of elevations, degrees.
_HEIGHT_M, _HEIGHT_STEP_M, _BIN_DEG = 0.5, 0.01, 0.01
#: Number of best models that are fitted in full, and the maximum number of pieces for that.
_CLOSELY, _ENOUGH = 6, 6000
#: Width of elevation peaks that are channels of a free table, degrees, and their minimum height and
#: prominence relative to high peaks.
_PEAK_DEG, _PEAK_SHARE = 0.05, 0.15


@dataclass(frozen=True, eq=False)
class TableFit:
    """A sensor's pose from a table of elevations.

    Attributes:
        seen_from: position and axis of the sensor.
        unit: its channels.
        covariance: (5, 5) of x, y, z (metres) and two angles `across` (radians).
        looks: (C,) number of independent observations of each channel.
        evidence: log marginal likelihood of the observations by this table, over all units.
        gain: log likelihood ratio of rings against no rings, minus half the free parameters times
            the logarithm of the observations: above 0 there are rings.
        within: share of the pieces within 0.05 degrees of a channel.
    """

    seen_from: Standpoint
    unit: Unit
    covariance: NDArray[np.float64]
    looks: NDArray[np.float64]
    evidence: float
    gain: float
    within: float

    def sees(self, points: NDArray[np.float64]) -> OnChannel:
        """Return the channels that see (N, 3) points."""
        return self.unit.sees(points, self.seen_from)


def fit_tables(
    pieces: RingPieces, weight: NDArray[np.float64], start: Standpoint, models: Sequence[Sensor]
) -> list[TableFit]:
    """Return the fits of the likeliest models, by falling evidence.

    Args:
        pieces: pieces of one sensor.
        weight: (P,) posterior probability that each piece is this sensor's.
        start: the sensor's position and axis, from the directions of its pieces.
        models: the candidates.
    """
    few, share = _enough(pieces, weight)
    ranked = []
    for model in models:
        score, height = _best_height(few, share, start, model.elevation_deg)
        ranked.append((score, height, model))
    ranked.sort(key=lambda one: -one[0])
    fits = []
    for _, height, model in ranked[:_CLOSELY]:
        at = Standpoint(start.place + [0, 0, height], start.axis)
        unit = Unit.of_table(model.elevation_deg, model)
        fits.append(_fit(few, share, (at, unit), start, _OF_MODEL))
    fits.sort(key=lambda one: -one.evidence)
    return fits


def fit_free_table(
    pieces: RingPieces, weight: NDArray[np.float64], start: Standpoint
) -> TableFit | None:
    """Return the pose from a table of no model, found with the pose; None without rings.

    The height is determined only by walls and the directions of the pieces.
    """
    few, share = _enough(pieces, weight)
    seen = start.elevation_deg(few.middle)
    count, edges = np.histogram(seen, np.arange(-90, 90 + _BIN_DEG, _BIN_DEG), weights=share)
    spread = _PEAK_DEG / _BIN_DEG
    bell = np.exp(-0.5 * (np.arange(-4 * spread, 4 * spread + 1) / spread) ** 2)
    smooth = np.convolve(count, bell, mode="same")
    some = smooth[smooth > 0.5]
    if not len(some):
        return None
    least = _PEAK_SHARE * float(np.percentile(some, 90))
    peaks, _ = find_peaks(smooth, height=least, prominence=least)
    if not len(peaks):
        return None
    unit = Unit.of_table(edges[peaks] + _BIN_DEG / 2, None)
    return _fit(few, share, (start, unit), start, _OF_NOBODY)


def fit_alike(
    free: TableFit,
    pieces: RingPieces,
    weight: NDArray[np.float64],
    start: Standpoint,
    models: Sequence[Sensor],
) -> list[TableFit]:
    """Return the fits of models similar to a free table, by falling evidence.

    Some units differ from their model by more than `_OF_MODEL`: an HDL-64E by 0.3 degrees. Their
    channels match the model's one by one in order of elevation.
    """
    few, share = _enough(pieces, weight)
    seen = np.sort(free.unit.elevation_deg[free.looks >= 1])
    fits = []
    for model in models:
        rising = np.argsort(model.elevation_deg, kind="stable")
        table = model.elevation_deg[rising]
        if not _FEWEST_ALIKE <= len(seen) <= len(table):
            continue
        firsts = range(len(table) - len(seen) + 1)
        offs = [seen - table[first : first + len(seen)] for first in firsts]
        best = int(np.argmin([float((off**2).mean()) for off in offs]))
        spacing = float(np.ptp(table)) / (len(table) - 1)
        if np.sqrt((offs[best] ** 2).mean()) > _ALIKE * spacing:
            continue
        offset = np.empty(len(table))
        offset[rising] = np.interp(
            np.arange(len(table)), np.arange(best, best + len(seen)), offs[best]
        )
        unit = Unit(model, model.elevation_deg, offset, np.zeros(len(table)))
        fits.append(_fit(few, share, (free.seen_from, unit), start, _OF_ODD_UNIT))
    return sorted(fits, key=lambda one: -one.evidence)


def _enough(
    pieces: RingPieces, weight: NDArray[np.float64]
) -> tuple[RingPieces, NDArray[np.float64]]:
    """Return pieces thinned to `_ENOUGH`, the same for all compared tables."""
    rows = np.arange(len(pieces))[:: max(1, len(pieces) // _ENOUGH)]
    return pieces.of(rows), weight[rows]


def channel_likelihood_ratio(fit: TableFit, pieces: RingPieces) -> NDArray[np.float64]:
    """Return the likelihood ratio (P,) of pieces: on a fit's channels against any elevation."""
    on = fit.sees(pieces.middle)
    return np.asarray((1 - _ON) + _ON * normal_density(on.off_deg, _RING_DEG) * on.room_deg)


def normal_density(off_deg: NDArray[np.float64], sigma_deg: float) -> NDArray[np.float64]:
    """Return the normal distribution's density (N,) per degree at angles off its mean."""
    density = np.exp(-0.5 * (off_deg / sigma_deg) ** 2) / (sigma_deg * np.sqrt(2 * np.pi))
    return np.asarray(density)


def _best_height(
    pieces: RingPieces, weight: NDArray[np.float64], at: Standpoint, table: NDArray[np.float64]
) -> tuple[float, float]:
    """Return the best mean log likelihood of a table at any height, and that height, metres."""
    count, _ = np.histogram(table, np.arange(-90, 90 + _BIN_DEG, _BIN_DEG))
    spread = 2 * _RING_DEG / _BIN_DEG
    bell = np.exp(-0.5 * (np.arange(-5 * spread, 5 * spread + 1) / spread) ** 2)
    bell /= bell.sum() * _BIN_DEG
    density = np.convolve(count, bell, mode="same") / len(table)
    score = np.log(_ON * density + (1 - _ON) / _OTHERS_DEG)
    best = (-np.inf, 0.0)
    for height in np.arange(-_HEIGHT_M, _HEIGHT_M + _HEIGHT_STEP_M / 2, _HEIGHT_STEP_M):
        seen = Standpoint(at.place + [0, 0, height], at.axis).elevation_deg(pieces.middle)
        bins = np.clip(((seen + 90) / _BIN_DEG).astype(np.int64), 0, len(score) - 1)
        best = max(best, (float((weight * score[bins]).sum() / weight.sum()), float(height)))
    return best


def _fit(
    pieces: RingPieces,
    weight: NDArray[np.float64],
    start: tuple[Standpoint, Unit],
    believed: Standpoint,
    freedom: Freedom,
) -> TableFit:
    """Return the fit of a table with its evidence, in units of independent observations.

    The prior of the pose comes from the directions of the pieces. The evidence is Laplace's
    approximation: the log likelihood of the elevations with the best channel offsets, minus the
    Occam factors of those (MacKay 2003, chapter 28), over all shares of the channels.
    """
    each = weight / _PIECES_PER_LOOK
    held = ring_residuals(pieces, believed).jacobian
    belief = Belief(believed, held.T @ (held * (each / pieces.sigma**2)[:, None]))
    seen_from, unit, covariance = fit_unit(pieces.middle, each, start, belief, freedom, _FINER_DEG)
    on = unit.sees(pieces.middle, seen_from)
    count = len(unit.table_deg)
    bell = normal_density(on.off_deg, _RING_DEG)
    near = np.abs(on.off_deg) < 3 * _RING_DEG
    looks = np.bincount(on.channel, each * near, minlength=count).astype(np.float64)
    likelihood = each * np.log(np.where(near, _ON * bell, (1 - _ON) / _OTHERS_DEG))
    # Observations per channel: with a uniform prior over the shares of the channels, a table is
    # penalised for channels without observations.
    spread = gammaln(count) - gammaln(looks.sum() + count) + gammaln(looks + 1).sum()
    chosen = np.log1p(looks * (freedom.offset_deg / _RING_DEG) ** 2)
    chosen += (unit.offset_deg / freedom.offset_deg) ** 2
    comb = float((each * np.log((1 - _ON) + _ON * bell * on.room_deg)).sum())
    free = int((looks > 0.5).sum()) + 5
    return TableFit(
        seen_from,
        unit,
        covariance,
        looks,
        float(likelihood.sum() + spread - 0.5 * chosen.sum()),
        comb - 0.5 * free * float(np.log(max(float(each.sum()), 2.0))),
        float(weight[np.abs(on.off_deg) < 0.05].sum() / weight.sum()),
    )
