"""All sensors fitted side by side: whose each piece is, by direction and elevation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from urbantwin.fidelity.discovery.elevation_match import (
    TableFit,
    fit_alike,
    fit_free_table,
    fit_tables,
    ring_odds,
)
from urbantwin.fidelity.discovery.ring_pieces import RingPieces
from urbantwin.fidelity.discovery.search import FEWEST_PIECES
from urbantwin.fidelity.discovery.standpoint import Standpoint, aslant, odds_of
from urbantwin.lidar import Sensor
from urbantwin.progress import Progress

__all__ = ["draws_rings", "fits_of", "fitted_together"]

#: How often pieces are shared out and sensors fitted.
_ROUNDS = 3
#: A piece is a sensor's, believed beforehand: of all pieces a tenth are nobody's.
_NOBODY = 0.1
#: Rings must be so much likelier than none (logarithm), and so many of the pieces lie on them.
_LEAST_GAIN, _LEAST_WITHIN = 20.0, 0.6
#: What a table that nobody knows must have, more than any model's (logarithm of odds).
_STRANGE = 50.0
#: Sensors are no nearer to each other, metres.
_APART_M = 0.25


def fits_of(
    pieces: RingPieces, weight: NDArray[np.float64], start: Standpoint, models: Sequence[Sensor]
) -> list[TableFit]:
    """Return the fits of a sensor that are rings, the likeliest first: models', or a free one."""
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


def _same(one: TableFit, other: TableFit) -> bool:
    """Return whether two fits are of one sensor: the search found it twice."""
    away = one.seen_from.place - other.seen_from.place
    return bool(np.sqrt((away**2).sum()) < _APART_M)


def draws_rings(pieces: RingPieces, seen_from: Standpoint, models: Sequence[Sensor]) -> bool:
    """Return whether pieces are of rings around a place: lines of edges have any elevation."""
    weight = np.ones(len(pieces))
    free = fit_free_table(pieces, weight, seen_from)
    if free is not None and _is_rings(free):
        return True
    return bool(fits_of(pieces, weight, seen_from, models))


def fitted_together(
    pieces: RingPieces, found: Sequence[Standpoint], models: Sequence[Sensor], tell: Progress
) -> list[list[TableFit]]:
    """Return the fits of each sensor that has rings, the likeliest first.

    A sensor that was found first took pieces that are another's; here all claim them at once, by
    their directions and, as soon as rings are known, by their elevations.

    Args:
        pieces: of all sensors.
        found: where they stand, roughly.
        models: that they may be.
        tell: called with the share done and what is being done.
    """
    if not found:
        return []
    share = _shares(np.array([odds_of(aslant(pieces, one), pieces.sigma) for one in found]))
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
                if fresh and not any(_same(fresh[0], one[0]) for one in kept):
                    kept.append(fresh)
        fits = kept
        standing = [one[0].seen_from for one in fits]
        if not fits:
            return []
        share = _shares(
            np.array(
                [
                    odds_of(aslant(pieces, one[0].seen_from), pieces.sigma)
                    * ring_odds(one[0], pieces)
                    for one in fits
                ]
            )
        )
    return fits


def _shares(odds: NDArray[np.float64]) -> NDArray[np.float64]:
    each = (1 - _NOBODY) / len(odds)
    return np.asarray(each * odds / (_NOBODY + each * odds.sum(axis=0)))
