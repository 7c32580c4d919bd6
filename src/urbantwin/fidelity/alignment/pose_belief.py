"""Probabilities of several poses, and the spread around each.

Every feature of the frame (a section of curb, of wall, of paint) belongs to an object that the
scene has, or not: cars, hedges and people are in no map. Both the share of mapped features and
their proximity to the scene by chance are measured, so that a frame with few mapped features
carries little evidence. The error of the scene is chosen as the one that explains the frame best.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.fidelity.alignment.pose_search import KINDS, Likeness, PoseSearch
from urbantwin.fidelity.alignment.search_span import SearchSpan

__all__ = ["Belief", "beliefs"]

#: Possible errors of a scene, metres: of a survey, or of a map drawn by volunteers.
_WIDTHS_M = (0.1, 0.3)
#: Extent and step of the search around each place, in multiples of the scene's error.
_AROUND, _STEP = 4.0, 2 / 3
#: Typical distance of points, which converts rotations into shifts, metres.
_LEVER_M = 12.0
#: Number of features of one object, with a common error, that count as one.
_ALIKE = 1.0
#: Positions per side and headings at which chance is measured, over at least this span, metres and
#: radians.
_PLACES, _TURNS, _LEAST_M, _LEAST_RAD = 10, 4, 3.0, np.radians(15.0)
#: Minimum gain by chance, by kind: see `pose_search`.
_LEAST_CHANCE = np.array([0.02, 0.02, 0.02, 0.02, 0.005, 0.02])


@dataclass(frozen=True, eq=False)
class Belief:
    """Probability of one of several places, and its spread.

    Attributes:
        share: share of the probability within the span that lies around this place.
        sigma_m: (2,) standard deviation east and north.
        sigma_rad: standard deviation of the heading.
        evidence: log likelihood ratio of raised objects, curbs and paint against chance. Ground
            heights are excluded, as they fit somewhere for any frame.
    """

    share: float
    sigma_m: NDArray[np.float64]
    sigma_rad: float
    evidence: float


def beliefs(
    search: PoseSearch, places: list[tuple[NDArray[np.float64], float]], span: SearchSpan
) -> list[Belief]:
    """Return the probability of each of several distinct places, which include all likely ones.

    Args:
        search: the search with frame and scene.
        places: (2,) east and north, metres, and heading, radians, of each.
        span: bounds of the pose.
    """
    told: list[tuple[float, list[Belief]]] = [
        _told(search, _measured(search, places, span, width), places, span) for width in _WIDTHS_M
    ]
    return max(told, key=lambda one: one[0])[1]


def _told(
    search: PoseSearch,
    like: Likeness,
    places: list[tuple[NDArray[np.float64], float]],
    span: SearchSpan,
) -> tuple[float, list[Belief]]:
    """Return the log likelihood of the best pose, and the beliefs."""
    steps = np.arange(-_AROUND, _AROUND + _STEP / 2, _STEP) * like.width_m
    turns = steps / _LEVER_M
    around = np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2)
    clouds = []
    for place, yaw in places:
        xy = place + around
        scores = search.fit(xy, yaw + turns, like)[2]
        inside = np.all(np.abs(xy - span.middle) <= span.reach_m + 1e-9, axis=1)
        turned = np.abs(np.angle(np.exp(1j * (yaw + turns - span.yaw))))
        held = inside[:, None] & (turned <= span.reach_rad + 1e-9)
        log = np.where(held, scores / _ALIKE, -np.inf)
        at, turned_by = np.unravel_index(log.argmax(), log.shape)
        alone = search.fit(xy[[at]], yaw + turns[[turned_by]], like.without_ground())[2]
        clouds.append((xy, log, float(alone[0, 0])))
    best = max(float(log.max()) for _, log, _ in clouds)
    if not np.isfinite(best):
        return -np.inf, [Belief(0.0, np.full(2, np.inf), np.inf, 0.0) for _ in places]
    mass = [np.exp(log - best) for _, log, _ in clouds]
    # Probability between two places belongs to the nearer one, and spreads both.
    shares = [
        float(likely[_nearest(number, places, xy, turns)].sum())
        for number, ((xy, _, _), likely) in enumerate(zip(clouds, mass, strict=True))
    ]
    found = []
    for (xy, _, evidence), likely, share in zip(clouds, mass, shares, strict=True):
        here = max(float(likely.sum()), 1e-300)
        place, turn = likely.sum(axis=1) / here, likely.sum(axis=0) / here
        spread = place @ (xy - place @ xy) ** 2
        wide = float(turn @ (turns - turn @ turns) ** 2)
        # The width alone spreads a determined pose by this; registration is more accurate.
        spread = np.sqrt(np.maximum(spread - (like.width_m / 2) ** 2, 0.0))
        wide = float(np.sqrt(max(wide - (like.width_m / 2 / _LEVER_M) ** 2, 0.0)))
        found.append(Belief(share / max(sum(shares), 1e-300), spread, wide, evidence))
    return best, found


def _nearest(
    number: int,
    places: list[tuple[NDArray[np.float64], float]],
    xy: NDArray[np.float64],
    turns: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Return the mask (P, Y) of the poses around one of several places that are nearest to it."""
    yaw = places[number][1]
    away = np.stack(
        [
            ((xy - place) ** 2).sum(axis=1)[:, None]
            + (_LEVER_M * np.angle(np.exp(1j * (yaw + turns - other)))) ** 2
            for place, other in places
        ]
    )
    return np.asarray(away.argmin(axis=0) == number)


def _measured(
    search: PoseSearch,
    places: list[tuple[NDArray[np.float64], float]],
    span: SearchSpan,
    width_m: float,
) -> Likeness:
    """Measure the gain of features by chance, and the share of features in the scene, by kind."""
    none = Likeness(width_m, np.zeros(KINDS), np.ones(KINDS))
    offsets = np.linspace(-1.0, 1.0, _PLACES) * max(span.reach_m, _LEAST_M)
    xy = span.middle + np.stack(np.meshgrid(offsets, offsets), -1).reshape(-1, 2)
    turns = np.linspace(-1.0, 1.0, _TURNS) * max(span.reach_rad, _LEAST_RAD)
    _, _, scores, gains = search.fit(xy, span.yaw + turns, none)
    known = gains[np.isfinite(scores)].reshape(-1, KINDS)
    chance = np.clip(known.mean(axis=0) if len(known) else np.ones(KINDS), _LEAST_CHANCE, 0.98)
    best = [search.fit(place[None], np.array([yaw]), none)[3][0, 0] for place, yaw in places]
    shared = (np.max(best, axis=0) - chance) / (1.0 - chance)
    return Likeness(width_m, np.clip(shared, 0.02, 0.9), chance)
