"""Joint fit of all sensors: pieces are assigned by direction and elevation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from urbantwin.fidelity.discovery.elevation_match import (
    TableFit,
    channel_likelihood_ratio,
    fit_alike,
    fit_free_table,
    fit_tables,
)
from urbantwin.fidelity.discovery.ring_pieces import RingPieces
from urbantwin.fidelity.discovery.search import FEWEST_PIECES
from urbantwin.fidelity.discovery.standpoint import (
    Standpoint,
    ring_likelihood_ratio,
    ring_residuals,
)
from urbantwin.lidar import Sensor
from urbantwin.progress import Progress

__all__ = ["draws_rings", "fits_of", "fitted_together"]

#: Rounds of assigning pieces and fitting sensors.
_ROUNDS = 3
#: Prior probability that a piece belongs to no sensor.
_NOBODY = 0.1
#: Minimum log likelihood ratio of rings against none, and minimum share of the pieces on rings.
_LEAST_GAIN, _LEAST_WITHIN = 20.0, 0.6
#: Minimum log posterior odds of a free table against every model's.
_STRANGE = 50.0


def fits_of(
    pieces: RingPieces, weight: NDArray[np.float64], start: Standpoint, models: Sequence[Sensor]
) -> list[TableFit]:
    """Return the valid fits of a sensor, the likeliest first: of models, or of a free table."""
    known = [one for one in fit_tables(pieces, weight, start, models) if _is_rings(one)]
    free = fit_free_table(pieces, weight, start)
    if free is None or not _is_rings(free):
        return known
    alike = [one for one in fit_alike(free, pieces, weight, start, models) if _is_rings(one)]
    known = sorted([*alike, *known], key=lambda one: -one.evidence)
    if alike or (known and known[0].evidence > free.evidence - _STRANGE):
        return known
    return [free, *known]


def _is_rings(fit: TableFit) -> bool:
    return fit.gain > _LEAST_GAIN and fit.within > _LEAST_WITHIN


def draws_rings(pieces: RingPieces, seen_from: Standpoint, models: Sequence[Sensor]) -> bool:
    """Return whether pieces are at the elevations of rings; those of edges are spread evenly."""
    weight = np.ones(len(pieces))
    free = fit_free_table(pieces, weight, seen_from)
    if free is not None and _is_rings(free):
        return True
    return any(map(_is_rings, fit_tables(pieces, weight, seen_from, models)))


def fitted_together(
    pieces: RingPieces, found: Sequence[Standpoint], models: Sequence[Sensor], tell: Progress
) -> list[list[TableFit]]:
    """Return the fits of each sensor that has rings, the likeliest first.

    The search may have assigned pieces of other sensors to one found early. Here each piece is
    shared among all sensors, by its direction and, once channels are known, by its elevation.

    Args:
        pieces: pieces of all sensors.
        found: approximate positions of the sensors.
        models: the candidates.
        tell: called with the fraction done and the current step.
    """
    if not found:
        return []
    share = _shares(
        np.array(
            [ring_likelihood_ratio(ring_residuals(pieces, one), pieces.sigma) for one in found]
        )
    )
    fits: list[list[TableFit]] = [[] for _ in found]
    standing = list(found)
    for turn in range(_ROUNDS):
        kept: list[list[TableFit]] = []
        for number, (start, mine) in enumerate(zip(standing, share, strict=True)):
            tell((turn + number / len(standing)) / _ROUNDS, f"model of sensor {number + 1}")
            own = mine > 0.5
            if own.sum() >= FEWEST_PIECES:
                candidates = [one.unit.model for one in fits[number] if one.unit.model]
                fresh = fits_of(
                    pieces.of(own), mine[own], start, models if turn != 1 else candidates
                )
                if fresh and not any(
                    one[0].seen_from.is_beside(fresh[0].seen_from) for one in kept
                ):
                    kept.append(fresh)
        fits = kept
        standing = [one[0].seen_from for one in fits]
        if not fits:
            return []
        share = _shares(
            np.array(
                [
                    ring_likelihood_ratio(ring_residuals(pieces, one[0].seen_from), pieces.sigma)
                    * channel_likelihood_ratio(one[0], pieces)
                    for one in fits
                ]
            )
        )
    return fits


def _shares(odds: NDArray[np.float64]) -> NDArray[np.float64]:
    each = (1 - _NOBODY) / len(odds)
    return np.asarray(each * odds / (_NOBODY + each * odds.sum(axis=0)))
