"""Grouping of datasets by scenario, whatever sensors, weather or variation they show."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.dataset.split.actor_places import ActorPlaces, moments_of
from urbantwin.dataset.split.sources import Source

__all__ = ["Scenario", "scenarios_of"]

#: Two recordings show one scenario if this share of the positions of moving actors, at common
#: moments, agrees within this distance (m) by track, and this share of the tracks does.
_SHARE, _NEAR_M, _OF_TRACKS = 0.05, 0.5, 0.25
#: Least number of such tracks. One is chance: runs with different seeds have the same track ids,
#: and the first vehicle at a stop line starts when the light turns green.
_TWO = 2
#: Fields of the requested traffic that `vary` changes.
_VARIED = ("scenario", "signal_offsets")
_SAME_PLACE_DEG = 1e-7
_TRACKS = 1 << 20


@dataclass(frozen=True)
class Scenario:
    """Datasets that belong together.

    Attributes:
        sources: the datasets.
        because: one sentence for each reason; empty for a single dataset.
    """

    sources: tuple[Source, ...]
    because: tuple[str, ...]

    @property
    def frames(self) -> int:
        """Number of frames."""
        return sum(source.frames for source in self.sources)


def scenarios_of(sources: Sequence[Source]) -> list[Scenario]:
    """Return datasets grouped by scenario, in the order of the first of each.

    Two datasets belong together if they have the same motion; if their requested traffic is the
    same but for what `urbantwin experiment vary` changes; or if their actors move alike (a variant
    of one run).
    """
    group = list(range(len(sources)))
    reasons: dict[int, list[str]] = {}

    def join(one: int, other: int, reason: str) -> None:
        kept, gone = sorted((group[one], group[other]))
        reasons.setdefault(kept, []).append(reason)
        if kept != gone:
            reasons[kept] += reasons.pop(gone, [])
            group[:] = [kept if member == gone else member for member in group]

    for told, reason in (
        (_motion, "the same motion"),
        (_traffic, "the same traffic was asked for"),
    ):
        known: dict[Any, int] = {}
        for number, source in enumerate(sources):
            key = told(source)
            if key is not None and known.setdefault(key, number) != number:
                join(known[key], number, reason)
    firsts = sorted(set(group))
    moving = {one: _moving(sources[one].places) for one in firsts} if len(firsts) > 1 else {}
    for one, other in combinations(firsts, 2):
        near = _at(sources[one]) - _at(sources[other])
        if np.abs(near).max() < _SAME_PLACE_DEG and _go_the_same_way(moving[one], moving[other]):
            join(one, other, "actors go the same ways")
    return [
        Scenario(
            tuple(source for source, mine in zip(sources, group, strict=True) if mine == number),
            tuple(dict.fromkeys(reasons.get(number, ()))),
        )
        for number in sorted(set(group))
    ]


def _motion(source: Source) -> str | None:
    value = source.manifest.get("motion_sha256")
    return value if isinstance(value, str) else None


def _traffic(source: Source) -> str | None:
    """Return what determines the traffic of a simulated motion, except what is varied."""
    made_from = source.manifest.get("made_from") or {}
    motion = made_from.get("motion") if isinstance(made_from, dict) else None
    asked = motion.get("asked") if isinstance(motion, dict) else None
    if not isinstance(asked, dict):
        return None
    fixed = {key: value for key, value in sorted(asked.items()) if key not in _VARIED}
    seeds = source.manifest.get("seeds") or {}
    return repr((fixed, seeds.get("traffic"), source.manifest.get("scene_sha256")))


def _at(source: Source) -> NDArray[np.float64]:
    """Return latitude and longitude of the site."""
    anchor = source.parts[0][1].get("anchor") or {}
    return np.array([float(anchor.get(key, 0.0)) for key in ("latitude", "longitude")])


@dataclass(frozen=True, eq=False)
class _Moving:
    """Moving actors: (N,) key of actor and moment, sorted, and (N, 2) position; moments."""

    key: NDArray[np.int64]
    place: NDArray[np.float64]
    moments: NDArray[np.int64]


def _moving(places: ActorPlaces) -> _Moving:
    chosen = places.has_moved()
    moments = moments_of(places.times_s)
    key = moments[places.moment[chosen]] * _TRACKS + places.track[chosen]
    ends = places.ends[chosen]
    order = np.argsort(key)
    return _Moving(key[order], ((ends[:, :2] + ends[:, 2:]) / 2)[order], moments)


def _go_the_same_way(one: _Moving, other: _Moving) -> bool:
    common = np.intersect1d(one.moments, other.moments)
    tracks = [mine.key[np.isin(mine.key // _TRACKS, common)] % _TRACKS for mine in (one, other)]
    shared, left, right = np.intersect1d(one.key, other.key, return_indices=True)
    if not len(shared):
        return False
    near = shared[np.hypot(*(one.place[left] - other.place[right]).T) < _NEAR_M]
    places = min(len(mine) for mine in tracks)
    actors = min(len(np.unique(mine)) for mine in tracks)
    meet = len(np.unique(near % _TRACKS))
    return len(near) >= _SHARE * places and meet >= max(_OF_TRACKS * actors, min(_TWO, actors))


def parked_places(scenarios: Sequence[Scenario]) -> Iterator[tuple[float, ...]]:
    """Yield site (latitude, longitude) and position, to half a metre, of every parked vehicle."""
    for source in (source for one in scenarios for source in one.sources):
        places = source.places
        where = (places.ends[places.parked, :2] + places.ends[places.parked, 2:]) / 2
        site = tuple(np.round(_at(source), 6).tolist())
        for x, y in np.unique(np.round(where * 2) / 2, axis=0).tolist():
            yield (*site, x, y)
