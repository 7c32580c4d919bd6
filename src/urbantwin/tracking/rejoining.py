"""Tracks of one road user that was lost for longer than filters dare to go on, joined."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from urbantwin.detections import Detections
from urbantwin.tracking.road_user import RoadUser
from urbantwin.traffic.recorded.rejoined import chains
from urbantwin.traffic.recorded.track import RecordedTrack

__all__ = ["rejoined_rows"]


def rejoined_rows(
    found: Detections,
    tracks: Sequence[NDArray[np.int64]],
    users: Sequence[RoadUser],
    time_s: NDArray[np.float64],
) -> list[NDArray[np.int64]]:
    """Return the rows of tracks, those of one road user together (`traffic.recorded.rejoined`).

    Args:
        found: detections in a frame of reference that does not move.
        tracks: rows of each.
        users: how each detection (N,) moves: only those that move alike are joined.
        time_s: (frames,) seconds.
    """
    as_recorded = [
        RecordedTrack(
            name=str(number),
            actor_class=users[int(rows[0])].name,
            time_s=time_s[found.frame[rows]],
            xy=found.box[rows, :2],
            yaw=found.box[rows, 6],
            z=found.box[rows, 2],
            size=np.median(found.box[rows, 3:6], axis=0),
        )
        for number, rows in enumerate(tracks)
    ]
    joined = [np.concatenate([tracks[k] for k in chain]) for chain in chains(as_recorded)]
    return sorted(joined, key=lambda rows: int(rows[0]))
