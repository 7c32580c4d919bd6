"""Searching for the places that rings were seen from, one sensor after the other."""

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
    aslant,
    odds_of,
)
from urbantwin.progress import Progress

__all__ = ["FEWEST_PIECES", "refined", "search_standpoints"]

#: Pieces that a sensor is found by at least: of less, chance makes rings.
FEWEST_PIECES = 80
#: More sensors than this nobody fuses; the search ends before, where nothing is left.
_MOST_SENSORS = 16
#: Places that agree with many pieces and drew no rings, until the search gives up.
_MOST_WRONG = 3
#: Pieces that vote, the distance of the places that they vote for, and how far out these are.
_VOTERS, _STEP_M, _FARTHEST_M = 800, 2.0, 60.0
#: Attitudes and heights above the ground that are tried: tilts in degrees each way round.
_TILTS_DEG, _WAYS = (7.0, 15.0), 8
_HEIGHTS_M, _UPRIGHT_HEIGHT_M = (2.0, 5.0), 2.5
#: Beside `_STEP_M`, the attitudes tried leave this open, radians.
_TILT_STEP_RAD = 0.03
#: Of each attitude so many places, and of all so many, are fitted, to so many pieces; and those,
#: from rough to fine, with this beside the standard deviations of the pieces.
_EACH, _FITTED, _TO = 4, 16, 2500
_FINER_RAD, _TIMES = (0.2, 0.1, 0.05, 0.025, 0.0), 4
#: Share of the pieces that are a sensor's, as believed beforehand.
_SHARE = 0.15
#: Rings on level ground do not tell the height: how far it may be off where the search began.
_HEIGHT_M, _TILT_RAD = 3.0, 0.2
#: A sensor is tilted no more, degrees, and stands so far above the lowest ring or below the
#: highest, metres: what is beyond is a chance of edges.
_MOST_TILTED_DEG, _BELOW_M, _ABOVE_M = 40.0, 0.3, 40.0
#: Sensors are no nearer to each other in place, metres; and a sensor is known to this at least.
_APART_M, _KNOWN_M = 0.25, 1.0


def search_standpoints(
    pieces: RingPieces,
    draws_rings: Callable[[RingPieces, Standpoint], bool],
    tell: Progress,
    seed: int,
) -> list[Standpoint]:
    """Return where the sensors stand that drew pieces of rings.

    The place that most pieces vote for is fitted to them; its pieces are taken out, and the rest
    votes again, until too few agree.

    Args:
        pieces: of all sensors together.
        draws_rings: whether the pieces that agree with a place are of rings, as seen from it;
            edges of buildings agree with many places.
        tell: called with the share done and what is being done.
        seed: which pieces vote follows from it.
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
        odds = odds_of(aslant(rest, seen_from), rest.sigma)
        mine = _SHARE * odds > 1 - _SHARE
        if mine.sum() < FEWEST_PIECES:
            break
        left[rows[mine]] = False
        apart = [np.linalg.norm(one.place - seen_from.place) for one in found]
        if min(apart, default=np.inf) > _APART_M and draws_rings(rest.of(mine), seen_from):
            found.append(seen_from)
        else:
            wrong += 1
    return found


def _starts(pieces: RingPieces, seed: int) -> list[Standpoint]:
    """Return the places and attitudes that most pieces vote for, the most first."""
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
    """Return a standpoint fitted to those of the pieces that are its rings; None if it ran away.

    Gauss-Newton steps in which each piece weighs what it is likely to be the sensor's, first
    with a wide tolerance, then with the pieces' own.

    Args:
        pieces: of this and other sensors.
        start: where the search begins; its height and upright attitude hold weakly.
        finer_rad: what is beside the pieces' own tolerance, from rough to fine.
    """
    seen_from = start
    for wider in finer_rad:
        for _ in range(_TIMES):
            seen = aslant(pieces, seen_from)
            spread = np.hypot(pieces.sigma, wider * seen.rise)
            odds = _SHARE / (1 - _SHARE) * odds_of(seen, spread)
            each = odds / (1 + odds) / spread**2
            normal = seen.jacobian.T @ (seen.jacobian * each[:, None])
            slope = seen.jacobian.T @ (each * seen.off)
            lean = np.array([one[2] for one in across(seen_from.axis)])
            height = seen_from.place[2] - start.place[2]
            normal[np.diag_indices(5)] += [1, 1, _HEIGHT_M**-2, _TILT_RAD**-2, _TILT_RAD**-2]
            slope += [0, 0, height / _HEIGHT_M**2, *(-lean / _TILT_RAD**2)]
            step = -np.linalg.solve(normal, slope)
            far = float(np.sqrt((step[:3] ** 2).sum()))
            step[:3] *= min(1.0, 2 * _KNOWN_M / max(far, 1e-9))
            seen_from = seen_from.moved(step)
            if seen_from.axis[2] < 0.5:
                return None
    return seen_from
