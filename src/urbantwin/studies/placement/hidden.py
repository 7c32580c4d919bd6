"""Why an actor is not seen: what hides it, from which sensor, and for how long."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from urbantwin.studies.placement.measure import LEVELS, least_expected
from urbantwin.studies.placement.moments import Moments
from urbantwin.studies.placement.sighting import NOBODY, Sighting
from urbantwin.taxonomy import semantic_classes

__all__ = ["Hidden", "hidden_actors"]

_SEEN = least_expected(LEVELS[0])
#: The ground and what lies on it does not hide: a beam that ends there was too low.
_WORDS = {
    "building": "a building",
    "vegetation": "a tree or a hedge",
    "trunk": "a tree",
    "pole": "a pole",
    "traffic-sign": "a traffic sign",
    "fence": "a fence or a wall",
    "other-structure": "a structure",
    "other-object": "something on the street",
    **dict.fromkeys(
        ("road", "parking", "sidewalk", "other-ground", "terrain"), "the ground before it"
    ),
}
_FEW = "few beams"


@dataclass(frozen=True)
class Hidden:
    """An actor that a layout does not see for a while.

    Attributes:
        track: the actor.
        kind: its class.
        from_s: when it is first not seen, of the motion.
        seconds: for how long it is not, all together.
        middle: (x, y) where it is in the middle of that, site frame, metres.
        behind: of each sensor, by its number in the layout, what hid it for the longest: in words.
        tracks: of each sensor, the actor that is; ``None``: none.
    """

    track: int
    kind: str
    from_s: float
    seconds: float
    middle: tuple[float, float]
    behind: tuple[str, ...]
    tracks: tuple[int | None, ...]


def hidden_actors(
    moments: Moments, sightings: Sequence[Sighting], most: int | None = None
) -> list[Hidden]:
    """Return the actors that a layout does not see, those first that it misses for longest.

    Args:
        moments: of the motion.
        sightings: of the layout's views.
        most: so many alone.
    """
    targets = moments.targets
    total = np.stack([one.points for one in sightings]).sum(axis=0)
    unseen = np.flatnonzero(total < _SEEN)
    found = []
    for track in np.unique(targets.track[unseen]).tolist():
        rows = unseen[targets.track[unseen] == track]
        rows = rows[np.argsort(targets.moment[rows])]
        middle = rows[len(rows) // 2]
        why = [_why(one, rows, moments) for one in sightings]
        found.append(
            Hidden(
                track,
                str(targets.kind[rows[0]]),
                round(moments.every[int(targets.moment[rows[0]])].time_s, 3),
                round(len(rows) * moments.step_s, 3),
                (
                    round(float(targets.middle[middle, 0]), 2),
                    round(float(targets.middle[middle, 1]), 2),
                ),
                tuple(words for words, _ in why),
                tuple(other for _, other in why),
            )
        )
    found.sort(key=lambda one: (-one.seconds, one.track))
    return found[:most]


def _why(sighting: Sighting, rows: np.ndarray, moments: Moments) -> tuple[str, int | None]:
    """Return what hides a target in some rows from one sensor: for most of them."""
    reasons: Counter[tuple[str, int | None]] = Counter()
    kind_of, names = _kinds(moments), _semantic_names()
    for row in rows.tolist():
        blocker = int(sighting.blocker[row])
        if sighting.alone[row] < _SEEN or blocker == NOBODY:
            reasons[_FEW, None] += 1
        elif blocker >= 0:
            reasons[f"{kind_of.get(blocker, 'actor')} {blocker}", blocker] += 1
        else:
            reasons[_WORDS.get(names[-1 - blocker], "something else"), None] += 1
    words, other = max(reasons.items(), key=lambda one: (one[1], one[0][0]))[0]
    if words == _FEW:
        beams, away = sighting.alone[rows].mean(), sighting.range_m[rows].mean()
        words = f"nothing, but {beams:.0f} points at most, {away:.0f} m away"
    return words, other


def _semantic_names() -> dict[int, str]:
    return {entry.id: entry.name for entry in semantic_classes().values()}


def _kinds(moments: Moments) -> dict[int, str]:
    """Return the class of every actor, those that are parked, too."""
    return {actor.track: actor.actor_class for moment in moments.every for actor in moment.actors}
