"""Split of a recording in time: training, validation and test, with gaps between them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.dataset.split.actor_places import ActorPlaces, Recorded, moments_of, places_of
from urbantwin.dataset.split.asked import PARTS, SplitAsked
from urbantwin.errors import InputError
from urbantwin.result_warning import ResultWarning

__all__ = ["Split", "check_split", "split_in_time", "thinned", "warnings_of_split"]


#: The scene has changed if at most this share of the moving actors overlaps with its old position.
CHANGED = 0.1
#: Number of moments that are compared with later ones, and of time lags.
_MOMENTS, _LAGS = 200, 60


def still_there(
    places: ActorPlaces, moves: NDArray[np.bool_], one: int, other: int
) -> tuple[int, int]:
    """Return how many moving actors overlap with their position at another moment, and of how many.

    An actor that moved less than its length overlaps: the second frame shows it with nearly the
    same points.
    """
    movers = _movers(places, moves, one)
    return _still(places, movers, np.full(len(movers), other)), len(movers)


def _movers(places: ActorPlaces, moves: NDArray[np.bool_], moment: int) -> NDArray[np.int64]:
    """Return the rows of the actors that move at a moment."""
    rows = places.at(moment)
    return np.asarray(np.flatnonzero(moves[rows]) + rows.start)


def _still(places: ActorPlaces, rows: NDArray[np.int64], later: NDArray[np.int64]) -> int:
    """Return how many of some rows (R,) overlap with their position at later moments (R,)."""
    later_rows, present = places.rows_at(later, places.track[rows])
    rows, later_rows = rows[present], later_rows[present]
    way = (places.ends[later_rows] - places.ends[rows]).reshape(-1, 2, 2).mean(axis=1)
    return int((np.hypot(*way.T) < places.length[rows]).sum())


def seconds_to_change(places: ActorPlaces, moves: NDArray[np.bool_]) -> float | None:
    """Return the time after which the scene has changed (`CHANGED`) on average, seconds.

    The shortest sufficient lag of up to half of the recording; ``None`` if none is. 0 without
    moving actors, whose frames waiting does not change.
    """
    times = places.times_s
    if not moves.any():
        return 0.0
    if len(times) < 3:
        return None
    step = float(np.median(np.diff(times)))
    most = float(times[-1] - times[0]) / 2
    lags = np.unique(np.round(np.geomspace(1, max(1.0, most / step), _LAGS)))
    starts = np.unique(np.linspace(0, len(times) - 1, _MOMENTS).astype(int))
    movers = [_movers(places, moves, one) for one in starts.tolist()]
    rows, counts = np.concatenate(movers), np.array([len(one) for one in movers])
    for lag in lags * step:
        later = np.searchsorted(times, times[starts] + lag - step / 100)
        within = later < len(times)
        compared = np.repeat(within, counts)
        still = _still(places, rows[compared], np.repeat(later, counts)[compared])
        compared_count = int(counts[within].sum())
        if compared_count and still <= CHANGED * compared_count:
            return round(float(lag), 3)
    return None


#: Largest automatic gap, as a share of the recording, and of the shorter part beside it.
_OF_RECORDING, _OF_PART = 0.1, 0.5
_ROUNDING_S = 1e-5


@dataclass(frozen=True, eq=False)
class Split:
    """Assignment of moments to parts.

    Attributes:
        moments: (T,) of all frames, as from `moments_of`.
        parts: indices of the moments of each part.
        cut: the same before thinning.
        told: description that all datasets share; see docs/howto/datasets.md.
    """

    moments: NDArray[np.int64]
    parts: Mapping[str, NDArray[np.int64]]
    cut: Mapping[str, NDArray[np.int64]]
    told: dict[str, Any]

    def told_of(self, frames: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
        """Return the description for a dataset's manifest; the argument is that of `frames`."""
        parts, cut = self.frames(frames), self._named(frames, self.cut)
        times = {str(one["name"]): float(one["time_s"]) for one in frames}
        told = dict(self.told)
        told["parts"] = {
            part: {"frames": len(names)}
            | ({"from_s": times[names[0]], "to_s": times[names[-1]]} if names else {})
            for part, names in parts.items()
        }
        told["frames_in_gaps"] = len(frames) - sum(map(len, cut.values()))
        if told["thinned"] is not None:
            left = {part: len(names) - len(parts[part]) for part, names in cut.items()}
            told["thinned"] = {**told["thinned"], "frames_left_out": left}
        return told

    def frames(self, frames: Sequence[Mapping[str, Any]]) -> dict[str, list[str]]:
        """Return the names of the frames of each part, in order of time.

        Args:
            frames: ``name`` and ``time_s`` of each.
        """
        return self._named(frames, self.parts)

    def _named(
        self, frames: Sequence[Mapping[str, Any]], parts: Mapping[str, NDArray[np.int64]]
    ) -> dict[str, list[str]]:
        when = moments_of([float(one["time_s"]) for one in frames])
        number = np.searchsorted(self.moments, when)
        return {
            part: [str(frames[k]["name"]) for k in np.flatnonzero(np.isin(number, mine)).tolist()]
            for part, mine in parts.items()
        }


def check_split(times_s: Sequence[float], asked: SplitAsked) -> None:
    """Check, before any work, that a gap leaves frames for every part.

    Raises:
        InputError: it does not.
    """
    if asked.gap_s is None:
        return
    times = np.asarray(np.unique(moments_of(times_s)) * 1e-6, np.float64)
    cut = _cut(times, asked.shares, asked.gap_s)
    empty = [part for part, mine in cut.items() if not len(mine)]
    if empty:
        raise InputError(
            f"{asked.gap_s:g} s between the parts leave no frame for {empty[0]}",
            place="--gap",
            expected=f"a shorter gap: the frames last {times[-1] - times[0]:g} s",
        )


def split_in_time(recorded: Sequence[Recorded], asked: SplitAsked) -> Split:
    """Split datasets of one motion at the same moments.

    The cuts are at the shares of the time, independent of the gap, so that recordings of one motion
    by other rigs or in other weather do not overlap across cuts. A gap is taken from the larger of
    the parts beside it, or from both.

    Raises:
        InputError: a requested gap leaves a part without a frame, or a table is damaged.
    """
    check_split([float(one["time_s"]) for mine in recorded for one in mine.frames], asked)
    places = places_of(recorded)
    times = places.times_s
    moves = places.has_moved()
    needed = seconds_to_change(places, moves)
    gap = asked.gap_s
    if gap is None:
        longest = _longest_gap(times, asked.shares)
        gap = round(longest if needed is None else min(needed, longest), 3)
    none = {part: np.zeros(0, np.int64) for part in PARTS}
    cut = none | _cut(times, asked.shares, gap)
    between = _least_between(times, cut)
    parts = {part: thinned(places, mine, asked.moved_m) for part, mine in cut.items()}
    told = {
        "by": "time",
        "shares": dict(zip(PARTS, (round(one, 6) for one in asked.shares), strict=True)),
        "gap_s": between,
        "gap_asked_s": asked.gap_s,
        "scene_changes_in_s": needed,
        "why": _why(between, needed, asked),
        "parts": {},
        "frames_in_gaps": 0,
        "thinned": None if asked.moved_m is None else {"moved_m": asked.moved_m},
        "where_they_stood": [
            _told_cut(places, moves, one, other)
            for one, other in pairwise((k, mine) for k, mine in parts.items() if len(mine))
        ],
        "actors": _shared(places, parts, parked=False),
        "parked": _shared(places, parts, parked=True),
    }
    return Split(moments_of(times), parts, cut, told)


def warnings_of_split(told: Mapping[str, Any]) -> Iterator[ResultWarning]:
    """Yield warnings about a split.

    Args:
        told: its description in a manifest.
    """
    empty = [part for part in PARTS if told["shares"][part] and not told["parts"][part]["frames"]]
    remedy = (
        "a longer recording; or other recordings to validate and test on: "
        "urbantwin dataset split --by scenario"
    )
    if empty:
        yield ResultWarning(
            "split", f"no frame for {' and '.join(empty)}", "too few frames", remedy
        )
        return
    needed, gap = told["scene_changes_in_s"], told["gap_s"]
    cuts = [one for one in told["where_they_stood"] if one["moving"]]
    if not cuts or (needed is not None and gap >= needed):
        return
    worst = max(cuts, key=lambda one: one["still"] / one["moving"])
    change = (
        f"the scene needs {needed:g} s to change"
        if needed is not None
        else "the scene does not change within half of the recording"
    )
    limit = ", and the default gap is at most a tenth of it"
    limit = "" if told["gap_asked_s"] is not None else limit
    yield ResultWarning(
        "split",
        f"the gap of {gap:g} s is short: {worst['still']} of {worst['moving']} moving actors stand "
        f"in {worst['to']} where they stood in {worst['from']}",
        change + limit,
        remedy,
    )


def _bounds(count: int, shares: Sequence[float]) -> dict[str, tuple[int, int]]:
    """Return the first index of each part and the one after its last, without gaps."""
    wanted = [(part, share) for part, share in zip(PARTS, shares, strict=True) if share > 0]
    wanted = wanted[:count]
    total = sum(share for _, share in wanted)
    bounds, first, cumulative = {}, 0, 0.0
    for k, (part, share) in enumerate(wanted):
        cumulative += share / total
        remaining = len(wanted) - k - 1
        last = min(max(first + 1, round(cumulative * count)), count - remaining)
        bounds[part] = (first, last if remaining else count)
        first = last
    return bounds


def _cut(
    times: NDArray[np.float64], shares: Sequence[float], gap_s: float
) -> dict[str, NDArray[np.int64]]:
    """Return the indices of the moments of each part with a share."""
    share = dict(zip(PARTS, shares, strict=True))
    bounds = _bounds(len(times), shares)
    kept = {part: np.ones(last - first, bool) for part, (first, last) in bounds.items()}
    for left, right in pairwise(bounds):
        cut = bounds[right][0]
        before, after = times[cut - 1], times[cut]
        until, since = after - gap_s, before + gap_s
        if share[left] > share[right]:
            since = after
        elif share[left] < share[right]:
            until = before
        else:
            middle = (before + after) / 2
            until, since = middle - gap_s / 2, middle + gap_s / 2
        # Adjacent frames need no gap shorter than their distance.
        until, since = min(until, before), max(since, after)
        if gap_s > after - before:
            first, last = bounds[left]
            kept[left] &= times[first:last] <= until + _ROUNDING_S
            first, last = bounds[right]
            kept[right] &= times[first:last] >= since - _ROUNDING_S
    return {part: np.flatnonzero(mine) + bounds[part][0] for part, mine in kept.items()}


def _longest_gap(times: NDArray[np.float64], shares: Sequence[float]) -> float:
    spans = [times[last - 1] - times[first] for first, last in _bounds(len(times), shares).values()]
    return float(min(_OF_RECORDING * (times[-1] - times[0]), _OF_PART * min(spans)))


def _least_between(times: NDArray[np.float64], cut: Mapping[str, NDArray[np.int64]]) -> float:
    """Return the least time from the last frame of a part to the first of the next."""
    there = [mine for mine in cut.values() if len(mine)]
    least = min((times[b[0]] - times[a[-1]] for a, b in pairwise(there)), default=0.0)
    return round(float(least), 3)


def thinned(
    places: ActorPlaces, moments: NDArray[np.int64], moved_m: float | None
) -> NDArray[np.int64]:
    """Return the moments at which the scene differs from the last kept one.

    Args:
        places: positions of all actors.
        moments: moments of one part, in order of time.
        moved_m: displacement of an actor that counts as a difference; all are kept if not given.
    """
    if moved_m is None or not len(moments):
        return moments
    kept = [int(moments[0])]
    for one in moments[1:].tolist():
        if places.differs(kept[-1], one, moved_m):
            kept.append(one)
    return np.array(kept, np.int64)


def _why(gap: float, needed: float | None, asked: SplitAsked) -> str:
    because = "Frames that follow each other show the same actors in nearly the same places, so "
    because += "each part is one piece of time"
    if asked.gap_s is not None:
        return f"{because}; the gap is as asked."
    if needed is None:
        return (
            f"{because}. Within half of the recording never fewer than {CHANGED:.0%} of the moving "
            "actors overlap with where they stood: the gap is the longest that the parts leave."
        )
    limit = "" if gap >= needed else "; so long a gap would leave too little of the parts"
    return (
        f"{because}. After {needed:g} s at most {CHANGED:.0%} of the moving actors overlap with "
        f"where they stood{limit}."
    )


def _told_cut(
    places: ActorPlaces,
    moves: NDArray[np.bool_],
    one: tuple[str, NDArray[np.int64]],
    other: tuple[str, NDArray[np.int64]],
) -> dict[str, Any]:
    """Return how many moving actors overlap between the frames on both sides of a cut."""
    still, of = still_there(places, moves, int(one[1][-1]), int(other[1][0]))
    return {"from": one[0], "to": other[0], "moving": of, "still": still}


def _shared(
    places: ActorPlaces, parts: Mapping[str, NDArray[np.int64]], *, parked: bool
) -> dict[str, int]:
    tracks = {part: places.within(moments, parked=parked) for part, moments in parts.items()}
    told = {part: len(mine) for part, mine in tracks.items()}
    for one, other in (("train", "val"), ("train", "test"), ("val", "test")):
        told[f"in {one} and {other}"] = len(tracks[one] & tracks[other])
    return told
