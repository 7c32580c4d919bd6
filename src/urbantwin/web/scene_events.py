"""Events for the time line."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import box_footprints
from urbantwin.web.tracks import Tracks

__all__ = ["events_of"]

#: Number of points from which an object counts as visible.
_APPEARED = 5
_MOST_APPEARED = 100
#: Near misses: largest gap, metres, and smallest closing speed, metres per second.
_NEAR_M, _CLOSING = 1.0, 2.0
_MOST_NEAR = 12
_STANDS_M = 0.1
_VEHICLES = ("car", "truck", "bus", "motorcycle", "van", "tram")


def events_of(tracks: Tracks | None) -> list[dict[str, Any]]:
    """Return events in order of time: kind, frame and tracks.

    First appearances (the first frame with points on an object, after the first frame of all), near
    misses (a vehicle and another object less than a metre apart, approaching at more than 2 m/s;
    the nearest time of each pair, the nearest dozen pairs), and the frame with most objects.
    """
    if tracks is None or not len(tracks.track):
        return []
    found = [*_first_appearances(tracks), *_near_misses(tracks), _most_actors(tracks)]
    return sorted(found, key=lambda one: (one["frame"], one["kind"], one["track"] or 0))


def _event(tracks: Tracks, row: int, kind: str, text: str) -> dict[str, Any]:
    frame = int(tracks.frame[row])
    time_s = round(float(tracks.time_s[frame]), 4)
    track = int(tracks.track[row])
    return {"time_s": time_s, "frame": frame, "kind": kind, "text": text, "track": track}


def _first_appearances(tracks: Tracks) -> list[dict[str, Any]]:
    told = tracks.points >= 0
    seen = (~told | (tracks.points >= _APPEARED)) & (tracks.track >= 0)
    rows = np.flatnonzero(seen)
    _, first = np.unique(tracks.track[rows], return_index=True)
    rows = np.sort(rows[first])
    rows = rows[tracks.frame[rows] > 0][:_MOST_APPEARED]
    return [
        _event(tracks, row, "first appearance", f"{_named(tracks, row)} appears")
        for row in rows.tolist()
    ]


def _near_misses(tracks: Tracks) -> list[dict[str, Any]]:
    nearest: dict[tuple[int, int], tuple[float, int, int, float]] = {}
    vehicle = np.isin(tracks.class_names, _VEHICLES)
    stands = _standing(tracks)
    for frame in range(len(tracks.time_s)):
        first, last = np.searchsorted(tracks.frame, (frame, frame + 1))
        for one, other, gap, speed in _near(tracks, vehicle, stands, int(first), int(last)):
            key = (int(tracks.track[one]), int(tracks.track[other]))
            if key not in nearest or gap < nearest[key][0]:
                nearest[key] = (gap, one, other, speed)
    told = sorted(nearest.values(), key=lambda row: row[:2])[:_MOST_NEAR]
    return [
        _event(
            tracks,
            one,
            "near miss",
            f"{_named(tracks, one)} and {_named(tracks, other)}: {gap:.1f} m apart, "
            f"closing by {speed:.1f} m/s",
        )
        for gap, one, other, speed in told
    ]


def _near(
    tracks: Tracks, vehicle: NDArray[np.bool_], stands: NDArray[np.bool_], first: int, last: int
) -> list[tuple[int, int, float, float]]:
    """Return pairs of rows of a frame that are close and approaching: rows, gap, speed."""
    rows = np.arange(first, last)
    rows = rows[~tracks.companion[rows] & ~stands[rows] & (tracks.track[rows] >= 0)]
    moving = np.linalg.norm(tracks.velocity[rows, :2], axis=1) > _CLOSING / 2
    if not moving.any() or len(rows) < 2:
        return []
    outlines = box_footprints(tracks.box[rows])
    tree = shapely.STRtree(outlines)
    asked = np.flatnonzero(moving)
    one, other = tree.query(outlines[asked], predicate="dwithin", distance=_NEAR_M)
    one = asked[one]
    keep = (one < other) | (~moving[other] & (one != other))
    one, other = one[keep], other[keep]
    a, b = np.minimum(rows[one], rows[other]), np.maximum(rows[one], rows[other])
    away = tracks.box[b, :3] - tracks.box[a, :3]
    length = np.linalg.norm(away[:, :2], axis=1)
    relative = tracks.velocity[b] - tracks.velocity[a]
    closing = -(relative[:, :2] * away[:, :2]).sum(axis=1) / np.maximum(length, 1e-6)
    apart = np.abs(away[:, 2]) < (tracks.box[a, 5] + tracks.box[b, 5]) / 2
    gap = shapely.distance(outlines[one], outlines[other])
    good = (closing > _CLOSING) & apart & (gap > 0) & (vehicle[a] | vehicle[b])
    return [(int(a[k]), int(b[k]), float(gap[k]), float(closing[k])) for k in np.flatnonzero(good)]


def _standing(tracks: Tracks) -> NDArray[np.bool_]:
    """Return which rows (R,) are of objects that never move; parked ones are passed closely."""
    _, who = np.unique(tracks.track, return_inverse=True)
    count = int(who.max(initial=-1)) + 1
    low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    np.minimum.at(low, who, tracks.box[:, :2])
    np.maximum.at(high, who, tracks.box[:, :2])
    return np.asarray(((high - low).max(axis=1) < _STANDS_M)[who])


def _most_actors(tracks: Tracks) -> dict[str, Any]:
    seen = (tracks.points < 0) | (tracks.points >= _APPEARED)
    counts = np.bincount(tracks.frame[seen], minlength=len(tracks.time_s))
    frame = int(counts.argmax())
    return {
        "time_s": round(float(tracks.time_s[frame]), 4),
        "frame": frame,
        "kind": "most actors",
        "text": f"most objects at once: {int(counts[frame])}",
        "track": None,
    }


def _named(tracks: Tracks, row: int) -> str:
    return f"{tracks.class_names[row]} {tracks.track[row]}"
