"""Evaluation of layouts from their views: figures with intervals, and occluded actors."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from urbantwin.lidar.sight import CELL_M
from urbantwin.studies.placement.beam_voxels import Voxels
from urbantwin.studies.placement.measure import LEVELS, MEASURES, least_expected
from urbantwin.studies.placement.moments import Moments, Squares
from urbantwin.studies.placement.sighting import NOBODY, Sighting
from urbantwin.taxonomy import semantic_classes

__all__ = ["RANGES_M", "ClassPoints", "Hidden", "Judge", "Verdict", "hidden_actors"]

#: Borders of the ranges by which points are summed up, metres from the nearest sensor.
RANGES_M = (0.0, 10.0, 20.0, 30.0, 50.0, np.inf)
#: Number of bootstrap samples of actors for 95 % intervals, and their seed.
_DRAWS, _SEED = 200, 19
#: Fewest points on an actor in a frame for it to count as seen.
_SEEN = least_expected(LEVELS[0])

#: The ground and flat objects on it do not occlude: a beam that ends there was too low.
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
class Verdict:
    """Evaluation of a layout.

    Attributes:
        values: value of each of `measure.MEASURES`.
        intervals: 95 % intervals of those that are means over actors, by bootstrap over actors with
            all their seconds. They cover other actors in the same traffic, but not other hours.
    """

    values: dict[str, float]
    intervals: dict[str, tuple[float, float]]


class ClassPoints(NamedTuple):
    """Points on actors of a class in a range interval.

    Attributes:
        kind: the class.
        from_m: start of the interval, metres.
        to_m: end of the interval, metres.
        seconds: total time of actors in it, seconds.
        points: mean points per frame.
        seen: fraction of this time with at least 5, 20 and 50 points.
    """

    kind: str
    from_m: float
    to_m: float
    seconds: float
    points: float
    seen: tuple[float, ...]


class Judge:
    """Evaluates layouts on one motion.

    Args:
        moments: moments of the motion.
        squares: squares of the ground.
        voxels: voxels of the traffic.
    """

    def __init__(self, moments: Moments, squares: Squares, voxels: Voxels) -> None:
        targets = moments.targets
        self._step_s, self._squares, self._voxels = moments.step_s, squares, voxels
        self._kind = targets.kind
        _, self._of_track = np.unique(targets.track, return_inverse=True)
        self._tracks = int(self._of_track.max()) + 1
        self._present = np.bincount(self._of_track, minlength=self._tracks).astype(np.float64)
        random = np.random.default_rng([_SEED, self._tracks])
        even = np.full(self._tracks, 1.0 / self._tracks)
        self._drawn = random.multinomial(self._tracks, even, size=_DRAWS).astype(np.float64)
        # Rows in the order in which an actor's moments follow each other.
        self._order = np.lexsort((targets.moment, self._of_track))
        track, moment = self._of_track[self._order], targets.moment[self._order]
        self._begins = np.ones(len(track), np.bool_)
        self._begins[1:] = (np.diff(track) != 0) | (np.diff(moment) != 1)

    def verdict(self, sightings: Sequence[Sighting], cost: float) -> Verdict:
        """Return the evaluation of a layout.

        Args:
            sightings: results of its views, at least one.
            cost: cost of the layout.
        """
        each = np.stack([one.points for one in sightings])
        total = each.sum(axis=0)
        values: dict[str, float] = {"cost": cost}
        intervals: dict[str, tuple[float, float]] = {}

        def mean(name: str, per_row: NDArray[np.generic]) -> None:
            values[name], intervals[name] = self._mean_of_rows(per_row.astype(np.float64))

        mean("points", total)
        for level in LEVELS:
            mean(f"seen_{level}", total >= least_expected(level))
        left = [total - one >= _SEEN for one in each]
        worst = int(np.argmin([int(one.sum()) for one in left]))
        mean("seen_5_one_failed", left[worst] if len(each) > 1 else np.zeros(len(total), np.bool_))
        mean("seen_5_by_two", (each >= _SEEN).sum(axis=0) >= 2)
        longest = self.longest_unseen_s(total)
        values["unseen_mean_s"], intervals["unseen_mean_s"] = self._mean_of_tracks(longest)
        values["unseen_longest_s"] = float(longest.max())
        sees = np.stack([one.sees for one in sightings]).any(axis=0)
        values["blind_m2"] = float((~sees).sum() * CELL_M**2)
        crossings = ~sees & self._squares.crossing
        values["blind_crossings_m2"] = float(crossings.sum() * CELL_M**2)
        passed = np.stack([one.passed for one in sightings]).any(axis=0)
        values["entropy_nats"] = float(self._voxels.entropy[passed].sum())
        ground = np.stack([one.ground for one in sightings]).sum(axis=0, dtype=np.float64)
        values["density_per_m2"], values["nuc"] = _spread(ground, CELL_M**2)
        rounded = {name: round(values[name], 6) for name in MEASURES}
        return Verdict(
            rounded, {name: (round(a, 6), round(b, 6)) for name, (a, b) in intervals.items()}
        )

    def longest_unseen_s(self, points: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the longest time (T,) with fewer than 5 points (P,) on each actor, seconds."""
        unseen = points[self._order] < _SEEN
        begins = self._begins | ~unseen
        run = np.cumsum(begins | np.append(False, ~unseen[:-1])) - 1
        length = np.bincount(run, unseen, minlength=int(run[-1]) + 1)
        first = np.searchsorted(run, np.arange(len(length)))
        longest = np.zeros(self._tracks)
        np.maximum.at(longest, self._of_track[self._order][first], length)
        return longest * self._step_s

    def by_class(self, sightings: Sequence[Sighting]) -> list[ClassPoints]:
        """Return the points on actors of each class, by range."""
        total = np.stack([one.points for one in sightings]).sum(axis=0)
        away = np.stack([one.range_m for one in sightings]).min(axis=0)
        found = []
        for kind in np.unique(self._kind).tolist():
            for low, high in pairwise(RANGES_M):
                here = total[(self._kind == kind) & (away >= low) & (away < high)]
                if not len(here):
                    continue
                shares = ((here >= least_expected(level)).mean() for level in LEVELS)
                seen = tuple(round(float(one), 4) for one in shares)
                seconds = round(len(here) * self._step_s, 3)
                found.append(
                    ClassPoints(kind, low, high, seconds, round(float(here.mean()), 2), seen)
                )
        return found

    def _mean_of_rows(self, values: NDArray[np.float64]) -> tuple[float, tuple[float, float]]:
        sums = np.bincount(self._of_track, values, minlength=self._tracks)
        drawn = (self._drawn @ sums) / (self._drawn @ self._present)
        return float(sums.sum() / self._present.sum()), _interval(drawn)

    def _mean_of_tracks(self, values: NDArray[np.float64]) -> tuple[float, tuple[float, float]]:
        return float(values.mean()), _interval((self._drawn @ values) / self._tracks)


def _interval(drawn: NDArray[np.float64]) -> tuple[float, float]:
    low, high = np.percentile(drawn, [2.5, 97.5])
    return float(low), float(high)


def _spread(points: NDArray[np.float64], cell_m2: float) -> tuple[float, float]:
    """Return points per area, and their normalised uniformity coefficient.

    The coefficient of Yu et al. 2018 (PU-Net, CVPR), used by Cai et al. 2023 (ICRA) for roadside
    LiDARs: the standard deviation over D equal areas of ``n / (N p)``, with n of N points in an
    area that is the fraction p of the total. Here the areas are squares of the junction's ground,
    not discs.
    """
    total = float(points.sum())
    if not len(points) or total <= 0:
        return 0.0, float(len(points)) ** 0.5
    return total / (len(points) * cell_m2), float((points * len(points) / total).std())


@dataclass(frozen=True)
class Hidden:
    """An actor that a layout does not see for some time.

    Attributes:
        track: track of the actor.
        kind: its class.
        from_s: first time when it is not seen, seconds of the motion.
        seconds: total time when it is not seen, seconds.
        middle: (x, y) position in the middle of that time, site frame, metres.
        behind: description of the main occluder of each sensor, in the layout's order.
        tracks: track of that occluder, if it is an actor.
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
    """Return the actors that a layout does not see, in descending order of time.

    Args:
        moments: moments of the motion.
        sightings: results of the layout's views.
        most: largest number of actors to return.
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
    """Return what most often occludes a target from a sensor, in some rows."""
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
    """Return the class of every actor, including parked ones."""
    return {actor.track: actor.actor_class for moment in moments.every for actor in moment.actors}
