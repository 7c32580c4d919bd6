"""How long a scene needs to change: what the gap between two parts follows from."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from urbantwin.dataset.split.actor_places import ActorPlaces

__all__ = ["CHANGED", "seconds_to_change", "still_there"]

#: A scene has changed when no more than this share of those who move overlaps with where it stood.
CHANGED = 0.1
#: So many moments are compared with later ones, at so many distances in time.
_MOMENTS, _LAGS = 200, 60


def still_there(
    places: ActorPlaces, moves: NDArray[np.bool_], one: int, other: int
) -> tuple[int, int]:
    """Return how many movers stand at another moment where they stood, and of how many.

    Whoever went less than its own length still overlaps with its old place: the second frame shows
    it with nearly the same points.
    """
    mine = _movers(places, moves, one)
    return _still(places, mine, np.full(len(mine), other)), len(mine)


def _movers(places: ActorPlaces, moves: NDArray[np.bool_], moment: int) -> NDArray[np.int64]:
    """Return the rows of those who move at a moment."""
    rows = places.at(moment)
    return np.asarray(np.flatnonzero(moves[rows]) + rows.start)


def _still(places: ActorPlaces, here: NDArray[np.int64], later: NDArray[np.int64]) -> int:
    """Return how many of some rows (R,) stand there still at later moments (R,)."""
    there, found = places.rows_at(later, places.track[here])
    here, there = here[found], there[found]
    way = (places.ends[there] - places.ends[here]).reshape(-1, 2, 2).mean(axis=1)
    return int((np.hypot(*way.T) < places.length[here]).sum())


def seconds_to_change(places: ActorPlaces, moves: NDArray[np.bool_]) -> float | None:
    """Return after how many seconds a scene has changed (`CHANGED`), on average over all moments.

    Of waiting periods up to half of the recording, the shortest that is enough; ``None`` if none
    is. Where nobody moves, frames do not become different by waiting: 0.
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
    mine, counts = np.concatenate(movers), np.array([len(one) for one in movers])
    for lag in lags * step:
        later = np.searchsorted(times, times[starts] + lag - step / 100)
        within = later < len(times)
        compared = np.repeat(within, counts)
        still = _still(places, mine[compared], np.repeat(later, counts)[compared])
        of = int(counts[within].sum())
        if of and still <= CHANGED * of:
            return round(float(lag), 3)
    return None
