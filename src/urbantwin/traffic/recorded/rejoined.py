"""Joining of tracks that a tracker broke in two.

An actor that is occluded for a moment continues under a new id. An end and a begin match if their
displacement agrees with the mean of both velocities (exact for constant acceleration), and the
difference of velocities is possible in the time between. Pairs minimise the total error (the
assignment problem).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from urbantwin.traffic.recorded.track import RecordedTrack
from urbantwin.traffic.recorded.track_smoothing import LONGEST_FILLED_S

__all__ = ["chains", "rejoined"]

#: Duration over which velocities at an end are taken, seconds, and least number of samples.
_VELOCITY_WINDOW_S, _MIN_SAMPLES = 0.8, 4
#: Tolerance of the displacement, metres, and its growth per second squared, metres.
_DISPLACEMENT_TOLERANCE_M, _DISPLACEMENT_GROWTH_MS2 = 0.8, 0.5
#: Tolerance of velocities, m/s, and maximum acceleration, m/s2.
_VELOCITY_TOLERANCE_MS, _MAX_ACCELERATION_MS2 = 1.0, 5.0
#: Maximum ratio of lengths of the same actor.
_MAX_LENGTH_RATIO = 1.35


@dataclass(frozen=True)
class _TrackEnd:
    """Begin or end of a track, with its velocity."""

    number: int
    time_s: float
    xy: NDArray[np.float64]
    velocity: NDArray[np.float64]


def rejoined(tracks: Sequence[RecordedTrack]) -> tuple[tuple[RecordedTrack, ...], int]:
    """Return tracks with those of one actor joined, and the number of joins.

    Nothing is interpolated: a gap remains, short enough to be filled later.
    """
    joined = [
        tracks[chain[0]] if len(chain) == 1 else _joined([tracks[k] for k in chain])
        for chain in chains(tracks)
    ]
    return tuple(joined), len(tracks) - len(joined)


def chains(tracks: Sequence[RecordedTrack]) -> list[list[int]]:
    """Return the numbers of tracks of the same actor, in order of time."""
    by_class: dict[str, list[int]] = defaultdict(list)
    for number, track in enumerate(tracks):
        if len(track.time_s) >= _MIN_SAMPLES:
            by_class[track.actor_class].append(number)
    after: dict[int, int] = {}
    for numbers in by_class.values():
        ends = [_track_end(k, tracks[k], slice(None, None, -1)) for k in numbers]
        starts = [_track_end(k, tracks[k], slice(None)) for k in numbers]
        starts.sort(key=lambda start: start.time_s)
        after |= _pairs(ends, starts, tracks)
    followers = set(after.values())
    numbers_by_actor = []
    for number in range(len(tracks)):
        if number in followers:
            continue
        chain = [number]
        while chain[-1] in after:
            chain.append(after[chain[-1]])
        numbers_by_actor.append(chain)
    return numbers_by_actor


def _track_end(number: int, track: RecordedTrack, order: slice) -> _TrackEnd:
    """Return the begin of a track, or, in reverse order, its end."""
    times, xy = track.time_s[order], track.xy[order]
    count = max(int((np.abs(times - times[0]) <= _VELOCITY_WINDOW_S).sum()), _MIN_SAMPLES)
    fitted = np.polynomial.polynomial.polyfit(np.abs(times[:count] - times[0]), xy[:count], 1)
    return _TrackEnd(number, float(times[0]), fitted[0], fitted[1])


def _pairs(
    ends: Sequence[_TrackEnd], starts: Sequence[_TrackEnd], tracks: Sequence[RecordedTrack]
) -> dict[int, int]:
    """Return the continuation of each track that has one."""
    begins = np.array([start.time_s for start in starts])
    rows: list[tuple[int, int, float]] = []
    for k, end in enumerate(ends):
        first, last = np.searchsorted(begins, [end.time_s + 1e-6, end.time_s + LONGEST_FILLED_S])
        for j in range(int(first), int(last)):
            off = _relative_error(end, starts[j], tracks)
            if off is not None:
                rows.append((k, j, off))
    if not rows:
        return {}
    # Only possible pairs, so that the matrix stays small.
    left, right = (sorted({row[side] for row in rows}) for side in (0, 1))
    price = np.full((len(left), len(right)), 10.0)
    for k, j, off in rows:
        price[left.index(k), right.index(j)] = off
    return {
        ends[left[a]].number: starts[right[b]].number
        for a, b in zip(*linear_sum_assignment(price), strict=True)
        if price[a, b] <= 1.0
    }


def _relative_error(
    end: _TrackEnd, start: _TrackEnd, tracks: Sequence[RecordedTrack]
) -> float | None:
    """Return the relative error of an end and a begin, at most 1; ``None`` if they do not match."""
    passed = start.time_s - end.time_s
    before = -end.velocity  # its time runs backwards
    missed = float(np.linalg.norm((before + start.velocity) / 2 * passed - (start.xy - end.xy)))
    changed = float(np.linalg.norm(start.velocity - before))
    share = max(
        missed / (_DISPLACEMENT_TOLERANCE_M + _DISPLACEMENT_GROWTH_MS2 * passed**2),
        changed / (_VELOCITY_TOLERANCE_MS + _MAX_ACCELERATION_MS2 * passed),
    )
    end_length_m, start_length_m = (tracks[x.number].size[0] for x in (end, start))
    if share > 1.0 or (
        end_length_m > 0
        and start_length_m > 0
        and not 1 / _MAX_LENGTH_RATIO < end_length_m / start_length_m < _MAX_LENGTH_RATIO
    ):
        return None
    return share


def _joined(parts: Sequence[RecordedTrack]) -> RecordedTrack:
    sizes = np.array([part.size for part in parts])
    is_known = np.isfinite(sizes).any(axis=0)
    size = np.full(3, np.nan)
    size[is_known] = np.nanmedian(sizes[:, is_known], axis=0)
    return RecordedTrack(
        parts[0].name,
        parts[0].actor_class,
        np.concatenate([part.time_s for part in parts]),
        np.concatenate([part.xy for part in parts]),
        np.concatenate([part.yaw for part in parts]),
        np.concatenate([part.z for part in parts]),
        size,
    )
