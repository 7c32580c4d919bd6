"""How likely each of several poses is, and how far what is likely spreads around it.

Every piece of what the frame shows (a stretch of curb, of wall, of paint) is of something that the
scene has too, or is not: cars, hedges and people are in no map. Which share is, and how near pieces
lie to the scene by chance, is measured, so that a frame of which little is mapped says little. How
far off the scene is about is chosen by what explains the frame best.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.fidelity.alignment.pose_search import KINDS, Likeness, PoseSearch
from urbantwin.fidelity.alignment.search_span import SearchSpan

__all__ = ["Belief", "beliefs"]

#: Scenes are wrong by one of these, metres: a survey, or a map that volunteers drew.
_WIDTHS_M = (0.1, 0.3)
#: What is likely is looked for this far around each place, in such steps, in widths.
_AROUND, _STEP = 4.0, 2 / 3
#: Points that turn with the heading are about so far away, metres.
_LEVER_M = 12.0
#: Pieces of one house, or one curb, are wrong together: so many count as one.
_ALIKE = 1.0
#: Where chance is measured: places to each side, and turns; over this at least, metres and radians.
_PLACES, _TURNS, _LEAST_M, _LEAST_RAD = 10, 4, 3.0, np.radians(15.0)
#: Less than this is not measured there, by kind: see `pose_search`.
_LEAST_CHANCE = np.array([0.02, 0.02, 0.02, 0.02, 0.005, 0.02])


@dataclass(frozen=True, eq=False)
class Belief:
    """How likely one of several places is, and how far it spreads.

    Attributes:
        share: of all that is likely within the span, what lies around this place.
        sigma_m: (2,) standard deviation east and north of what lies there.
        sigma_rad: of its headings.
        evidence: logarithm of how much likelier what stands, curbs and paint are there than by
            chance. Heights of the ground fit somewhere whatever the frame shows.
    """

    share: float
    sigma_m: NDArray[np.float64]
    sigma_rad: float
    evidence: float


def beliefs(
    search: PoseSearch, places: list[tuple[NDArray[np.float64], float]], span: SearchSpan
) -> list[Belief]:
    """Return how likely each of several distinct places is, all likely ones being among them.

    Args:
        search: knows the frame and the scene.
        places: (2,) east and north, metres, and heading, radians, of each.
        span: nothing outside of it is likely.
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
    """Return how likely the likeliest pose is (a logarithm), and the beliefs."""
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
    # What lies between two places is told of the nearer one, and spreads both.
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
        # A pose that is held spreads as far as this by the width alone; registration knows better.
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
    """Return which poses (P, Y) around one of several places lie nearest to that one."""
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
    """Measure what pieces gain by chance, and how many of them the scene has, by kind."""
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
