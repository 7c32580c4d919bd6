"""Free-flow speeds: desired speeds of drivers, as far as observable."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.spatial import cKDTree

from urbantwin.traffic.calibration.passages import STANDS_MS, Passage, SeenTrack

__all__ = ["free_speeds"]

#: Distance, metres, and time, seconds, within which a preceding vehicle at the same place counts as
#: close ahead.
_SAME_PLACE_M, _CLOSE_AHEAD_S = 2.5, 4.0
#: Interval before the end of a track in which speeds are taken, seconds, and least length of a
#: track, metres.
_LAST_SECONDS_S, _MIN_PATH_M = 3.0, 40.0


def free_speeds(
    tracks: Sequence[SeenTrack],
    passages: Sequence[Passage],
    limits: Mapping[str, float],
    begin_s: float,
    end_s: float,
) -> dict[str, list[float]]:
    """Return, by exit, the highest speeds of leaving vehicles, as shares of the limit.

    A vehicle accelerates when it leaves a junction, and is fastest at the end of its track.
    Vehicles with another vehicle or bicycle close ahead there are excluded, and so are those that
    stood beyond the junction, for example at the next signal, and still accelerate.

    Args:
        tracks: all tracks, as possible leaders.
        passages: passages over the junction.
        limits: road -> m/s.
        begin_s: first time at which tracks may end.
        end_s: last time at which tracks may end.
    """
    drive = [track for track in tracks if track.track.actor_class != "pedestrian"]
    leave = [
        passage
        for passage in passages
        if passage.leaving in limits
        and begin_s <= passage.seen.time_s[-1] < end_s
        and np.linalg.norm(passage.seen.xy[-1] - passage.seen.xy[0]) > _MIN_PATH_M
        and not _stood_behind(passage)
    ]
    if not leave:
        return {}
    where = np.concatenate([track.xy for track in drive])
    when = np.concatenate([track.time_s for track in drive])
    track_index = np.repeat(np.arange(len(drive)), [len(track.time_s) for track in drive])
    number = {id(track.track): k for k, track in enumerate(drive)}
    neighbours = cKDTree(where).query_ball_point(
        [passage.seen.xy[-1] for passage in leave], _SAME_PLACE_M
    )
    speeds: dict[str, list[float]] = defaultdict(list)
    for passage, rows_nearby in zip(leave, neighbours, strict=True):
        seen, rows = passage.seen, np.array(rows_nearby, int)
        before = float(seen.time_s[-1]) - when[rows]
        close = (
            (before > 0)
            & (before < _CLOSE_AHEAD_S)
            & (track_index[rows] != number.get(id(seen.track), -1))
        )
        if not close.any():
            last = np.abs(seen.speed[seen.time_s > seen.time_s[-1] - _LAST_SECONDS_S])
            speeds[passage.leaving].append(float(last.max()) / limits[passage.leaving])
    return dict(speeds)


def _stood_behind(one: Passage) -> bool:
    """Return whether a vehicle stood after it had passed the stop line."""
    past_line = ~(one.seen.time_s <= one.passed_s)
    return bool((np.abs(one.seen.speed[past_line]) < STANDS_MS).any())
