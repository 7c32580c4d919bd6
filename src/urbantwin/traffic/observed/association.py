"""Association of the objects of consecutive frames to tracks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from urbantwin.geometry import wrapped
from urbantwin.traffic.observed.box_fit import SeenObject
from urbantwin.traffic.observed.frame_times import FrameTimes

__all__ = ["SeenTrack", "tracks_of"]

#: Maximum speeds, m/s: on foot, on a bicycle, in a vehicle; and position error, metres.
WALKS_M_S, RIDES_M_S, DRIVES_M_S, ERROR_M = 2.2, 7.0, 17.0, 0.5
#: Maximum acceleration, m/s2.
ACCELERATES = 6.0
#: Diagonal above which an object is a vehicle, metres; and maximum difference of diagonals, because
#: parts may be hidden.
LARGE_M, HIDDEN_M = 2.4, 2.5
#: Diagonal below which an object is a pedestrian, metres.
PERSON_M = 1.2
#: Maximum difference in height, metres; smaller ones add to the cost like a lateral offset.
TALLER_M = 0.7
#: Number of points in both frames from which a vehicle's height is reliable, and its tolerance,
#: metres.
WELL_SEEN, SAME_HEIGHT_M = 300, 0.2
#: Maximum difference in the share of moving points: a static object does not start to move.
SAME_SHARE = 0.7
#: Distance, metres, within which a pedestrian may become a rider or vehicle, because an outline may
#: be partly hidden.
SAME_PLACE_M = 1.0
#: Share of moving points below which a vehicle is static in most frames; after a gap its position
#: and size must agree within this tolerance, metres.
STANDS, SAME_M = 0.5, 0.4
#: Maximum number of frames without a detection.
LOST = 1
#: Maximum angle between a vehicle's long side and its motion, radians.
ALONG = np.radians(40.0)
#: Cost of an impossible pair.
NEVER = 1e6


@dataclass(eq=False)
class SeenTrack:
    """An object over several frames.

    Attributes:
        seen: the object in each frame in which it was detected.
        velocity: (2,) m/s at the last detection; ``None`` after a single one.
    """

    seen: list[SeenObject]
    velocity: NDArray[np.float64] | None = None

    def cost(self, one: SeenObject, seconds: float) -> float:
        """Return the cost of an object as the continuation after a time, metres."""
        last = self.seen[-1]
        kind = one.detected_class
        if kind != last.detected_class:
            return NEVER
        step = one.middle - last.middle
        moved_m = float(np.linalg.norm(step))
        large = kind is None and max(one.diagonal, last.diagonal) > LARGE_M
        on_foot = kind == "pedestrian"
        if kind is None:
            on_foot = max(one.diagonal, last.diagonal) < PERSON_M
        most = DRIVES_M_S if large else WALKS_M_S if on_foot else RIDES_M_S
        if moved_m > most * seconds + ERROR_M or abs(one.diagonal - last.diagonal) > HIDDEN_M:
            return NEVER
        taller = abs(one.top - last.top)
        well = large and min(len(one.points), len(last.points)) >= WELL_SEEN
        outlines = {_outline(each) for each in (one, last)} - {None}
        if (
            abs(one.moves - last.moves) > SAME_SHARE
            or taller > (SAME_HEIGHT_M if well else TALLER_M)
            or (len(outlines) > 1 and moved_m > SAME_PLACE_M)
        ):
            return NEVER
        if large and moved_m > 2 * ERROR_M:
            heading = np.arctan2(step[1], step[0])
            for each in (one, last):
                off = abs(float(wrapped(2 * (heading - each.long_way)))) / 2
                if each.diagonal > LARGE_M and off > ALONG:
                    return NEVER
        if self.velocity is None:
            return moved_m / 2 + abs(one.diagonal - last.diagonal) + taller
        off = float(np.linalg.norm(step - self.velocity * seconds))
        return off + taller if off < ACCELERATES * seconds**2 + 2 * ERROR_M else NEVER

    @property
    def stands(self) -> bool:
        """Whether its last detection is a vehicle that is static in most frames."""
        return self.seen[-1].moves < STANDS and self.seen[-1].diagonal > LARGE_M

    def cost_standing(self, one: SeenObject) -> float:
        """Return the cost of an object as the same static vehicle after a gap, metres."""
        last = self.seen[-1]
        moved_m = float(np.linalg.norm(one.middle - last.middle))
        off = abs(one.diagonal - last.diagonal) + abs(one.top - last.top)
        same = one.moves < STANDS and one.diagonal > LARGE_M
        return moved_m + off if same and max(moved_m, off) < SAME_M else NEVER

    def add(self, one: SeenObject, seconds: float) -> None:
        """Append a detection after a time, and update the velocity."""
        velocity = (one.middle - self.seen[-1].middle) / seconds
        # At high frame rates the velocity is averaged over some tenths of a second.
        share = min(1.0, 3 * seconds) if self.velocity is not None else 1.0
        before = self.velocity if self.velocity is not None else velocity
        self.velocity = before + share * (velocity - before)
        self.seen.append(one)


def _outline(one: SeenObject) -> str | None:
    """Return the class by outline, or ``vehicle``; ``None`` if neither is known."""
    if one.silhouette is None and one.diagonal > LARGE_M:
        return "vehicle"
    return one.silhouette


def tracks_of(frames: Sequence[Sequence[SeenObject]], times: FrameTimes) -> list[SeenTrack]:
    """Return the tracks of objects; those detected once included.

    No track continues over a gap, except vehicles that are static in most frames.

    Args:
        frames: the objects of each frame.
        times: times of the frames.
    """
    done: list[SeenTrack] = []
    active: list[SeenTrack] = []
    times_s, group = times.time_s, times.group()
    for number, objects in enumerate(frames):
        followed, stood = list[SeenTrack](), list[SeenTrack]()
        for track in active:
            last = track.seen[-1].frame
            same_group = group[last] == group[number]
            stays_open = number - last <= LOST + 1 and (same_group or track.stands)
            (done if not stays_open else followed if same_group else stood).append(track)
        active = followed + stood
        taken = set[int]()
        if active and objects:
            since = [float(times_s[number] - times_s[track.seen[-1].frame]) for track in active]
            cost = np.array(
                [
                    *(
                        [track.cost(item, s) for item in objects]
                        for track, s in zip(followed, since, strict=False)
                    ),
                    *([track.cost_standing(item) for item in objects] for track in stood),
                ]
            )
            for row, column in zip(*linear_sum_assignment(cost), strict=True):
                if cost[row, column] < NEVER:
                    active[row].add(objects[column], since[row])
                    taken.add(int(column))
        active += [SeenTrack([item]) for k, item in enumerate(objects) if k not in taken]
    return done + active
