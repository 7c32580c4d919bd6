"""Search for the positions from which rings were seen, one sensor after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from urbantwin.fidelity.compiled.place_votes import place_votes
from urbantwin.fidelity.discovery.ring_pieces import RingPieces
from urbantwin.fidelity.discovery.standpoint import (
    LEAST_RISE,
    Standpoint,
    across,
    ring_likelihood_ratio,
    ring_residuals,
)
from urbantwin.progress import Progress

__all__ = ["FEWEST_PIECES", "refined", "search_standpoints"]

#: Minimum number of pieces of a sensor: fewer may agree by chance.
FEWEST_PIECES = 80
#: Largest number of sensors; the search ends earlier when too few pieces are left.
_MOST_SENSORS = 16
#: Number of rejected positions, with many pieces but no rings around them, that ends the search.
_MOST_WRONG = 4
#: Number of voting pieces; spacing and reach of the position grid, metres.
_VOTERS, _STEP_M, _FARTHEST_M = 800, 2.0, 60.0
#: Tilts of the grid, degrees, number of directions of each, and heights above the ground, metres.
_TILTS_DEG, _WAYS = (7.0, 15.0), 8
_HEIGHTS_M, _UPRIGHT_HEIGHT_M = (2.0, 5.0), 2.5
#: Standard deviation that the coarse grid of tilts adds to the directions of pieces, radians.
_TILT_STEP_RAD = 0.03
#: Best positions kept per attitude, and over all attitudes; number of pieces to which these are
#: fitted; tolerances from coarse to fine, added to the standard deviations of the pieces; and steps
#: with each.
_EACH, _FITTED, _TO = 4, 16, 2500
_FINER_RAD, _TIMES = (0.2, 0.1, 0.05, 0.025, 0.0), 4
#: Prior probability that a piece is this sensor's.
_SHARE = 0.15
#: Prior standard deviations of height, metres, and tilt, radians: rings on level ground do not
#: determine the height.
_HEIGHT_M, _TILT_RAD = 3.0, 0.2
#: Largest tilt, degrees; least height above the lowest ring and largest above the highest, metres:
#: beyond these, edges agree by chance.
_MOST_TILTED_DEG, _BELOW_M, _ABOVE_M = 40.0, 0.3, 40.0
#: Longest step of a place, metres.
_LONGEST_STEP_M = 2.0


def search_standpoints(
    pieces: RingPieces,
    draws_rings: Callable[[RingPieces, Standpoint], bool],
    tell: Progress,
    seed: int,
) -> list[Standpoint]:
    """Return the positions and axes of the sensors that produced pieces of rings.

    The position with most votes is fitted to the pieces. The pieces that agree with it are removed,
    and the rest vote again, until too few agree.

    Args:
        pieces: pieces of all sensors.
        draws_rings: returns whether the pieces that agree with a position are rings seen from it;
            edges of buildings agree with many positions.
        tell: called with the fraction done and the current step.
        seed: seed of the voting pieces.
    """
    found: list[Standpoint] = []
    left = np.ones(len(pieces), np.bool_)
    bounds = np.percentile(pieces.middle[:, 2], [2, 98]) if len(pieces) else np.zeros(2)
    wrong = 0
    while len(found) < _MOST_SENSORS and wrong < _MOST_WRONG:
        tell(1 - 0.75 ** (len(found) + wrong), f"sensor {len(found) + 1}")
        rows = np.flatnonzero(left)
        if len(rows) < FEWEST_PIECES:
            break
        rest = pieces.of(rows)
        some = _drawn(rest, _TO, seed)
        best: tuple[float, Standpoint] | None = None
        for start in _starts(rest, seed):
            near = refined(some, start)
            if near is None or not _possible(near, bounds):
                continue
            votes = _votes(some, near.place[None], near.axis, 0.0)[0]
            if best is None or votes > best[0]:
                best = float(votes), near
        seen_from = None if best is None else refined(rest, best[1], _FINER_RAD[-2:])
        if seen_from is None:
            break
        odds = ring_likelihood_ratio(ring_residuals(rest, seen_from), rest.sigma)
        mine = _SHARE * odds > 1 - _SHARE
        if mine.sum() < FEWEST_PIECES:
            break
        left[rows[mine]] = False
        is_new = not any(one.is_beside(seen_from) for one in found)
        is_new = is_new and _possible(seen_from, bounds)
        if is_new and draws_rings(rest.of(mine), seen_from):
            found.append(seen_from)
        else:
            wrong += 1
    return found


def _starts(pieces: RingPieces, seed: int) -> list[Standpoint]:
    """Return the positions and attitudes with the most votes, in falling order."""
    voters = _drawn(pieces, _VOTERS, seed)
    low, high = np.percentile(pieces.middle[:, :2], [1, 99], axis=0)
    middle = (low + high) / 2
    reach = np.minimum((high - low) / 2 + 2 * _STEP_M, _FARTHEST_M)
    x, y = (np.arange(m - r, m + r + _STEP_M, _STEP_M) for m, r in zip(middle, reach, strict=True))
    plan = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    ground = float(np.median(pieces.middle[:, 2]))
    ranked = []
    for axis, heights in _attitudes():
        upright = axis[2] > 1 - 1e-9
        sigma = voters.sigma if upright else np.hypot(voters.sigma, _TILT_STEP_RAD)
        for height in heights:
            places = np.column_stack([plan, np.full(len(plan), ground + height)])
            votes = _votes(voters, places, axis, 0.4 * _STEP_M, sigma)
            most = np.argsort(-votes, kind="stable")[:_EACH]
            ranked += [(float(votes[row]), Standpoint(places[row], axis)) for row in most]
    ranked.sort(key=lambda one: -one[0])
    return [one for _, one in ranked[:_FITTED]]


def _drawn(pieces: RingPieces, most: int, seed: int) -> RingPieces:
    many = min(len(pieces), most)
    return pieces.of(np.random.default_rng(seed).choice(len(pieces), many, replace=False))


def _attitudes() -> Iterator[tuple[NDArray[np.float64], tuple[float, ...]]]:
    yield np.array([0.0, 0.0, 1.0]), (_UPRIGHT_HEIGHT_M,)
    for tilt in np.radians(_TILTS_DEG):
        for way in np.arange(_WAYS) * 2 * np.pi / _WAYS:
            flat = np.sin(tilt)
            yield np.array([flat * np.cos(way), flat * np.sin(way), np.cos(tilt)]), _HEIGHTS_M


def _votes(
    pieces: RingPieces,
    places: NDArray[np.float64],
    axis: NDArray[np.float64],
    coarse: float,
    sigma: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    spread = pieces.sigma if sigma is None else sigma
    votes: NDArray[np.float64] = place_votes(
        pieces.middle, pieces.along, spread, places, axis, coarse, _SHARE, LEAST_RISE
    )
    return votes


def _possible(seen_from: Standpoint, bounds: NDArray[np.float64]) -> bool:
    low, high = bounds[0] + _BELOW_M, bounds[1] + _ABOVE_M
    upright = seen_from.tilt < np.radians(_MOST_TILTED_DEG)
    return bool(upright and low < seen_from.place[2] < high)


def refined(
    pieces: RingPieces, start: Standpoint, finer_rad: Sequence[float] = _FINER_RAD
) -> Standpoint | None:
    """Return a standpoint fitted to the pieces that are its rings; None if the fit diverges.

    In Gauss-Newton steps, each piece is weighted with the posterior probability that it is the
    sensor's, first with a wide tolerance, in the end with the pieces' own.

    Args:
        pieces: pieces of this and other sensors.
        start: start of the search; a weak prior on its height and on an upright axis applies.
        finer_rad: tolerances added to the pieces' own, from coarse to fine.
    """
    seen_from = start
    for wider in finer_rad:
        for _ in range(_TIMES):
            seen = ring_residuals(pieces, seen_from)
            spread = np.hypot(pieces.sigma, wider * seen.rise)
            odds = _SHARE / (1 - _SHARE) * ring_likelihood_ratio(seen, spread)
            each = odds / (1 + odds) / spread**2
            normal = seen.jacobian.T @ (seen.jacobian * each[:, None])
            slope = seen.jacobian.T @ (each * seen.off)
            lean = np.array([one[2] for one in across(seen_from.axis)])
            height = seen_from.place[2] - start.place[2]
            normal[np.diag_indices(5)] += [1, 1, _HEIGHT_M**-2, _TILT_RAD**-2, _TILT_RAD**-2]
            slope += [0, 0, height / _HEIGHT_M**2, *(-lean / _TILT_RAD**2)]
            step = -np.linalg.solve(normal, slope)
            far = float(np.sqrt((step[:3] ** 2).sum()))
            step[:3] *= min(1.0, _LONGEST_STEP_M / max(far, 1e-9))
            seen_from = seen_from.moved(step)
            if seen_from.axis[2] < 0.5:
                return None
    return seen_from
