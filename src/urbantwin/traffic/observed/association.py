"""Objects of one frame after another as tracks."""

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

#: Faster than this nobody is, m/s: on foot, on a bicycle, in a vehicle; and metres of error.
WALKS_M_S, RIDES_M_S, DRIVES_M_S, ERROR_M = 2.2, 7.0, 17.0, 0.5
#: Nobody gets faster or slower than this, m/s2.
ACCELERATES = 6.0
#: Larger than this is a vehicle, metres from corner to corner; as much may be hidden of one.
LARGE_M, HIDDEN_M = 2.4, 2.5
#: Smaller than this is a person on foot, metres.
PERSON_M = 1.2
#: Nobody gets taller or shorter by more, metres; what is less is as unlikely as a step aside.
TALLER_M = 0.7
#: Vehicles of which so many points were seen in both frames keep their height so far, metres.
WELL_SEEN, SAME_HEIGHT_M = 300, 0.2
#: What always stood in one frame does not move in another: the shares of points that do, apart.
SAME_SHARE = 0.7
#: Who walks in one frame and rides or drives in the next is somebody else, unless it is as near as
#: this, metres: an outline may be hidden in part.
SAME_PLACE_M = 1.0
#: A vehicle of which so small a share of the points moves stood there in most frames; after a gap
#: it is in the same place and as large, metres.
STANDS, SAME_M = 0.5, 0.4
#: Frames that a track may be out of sight.
LOST = 1
#: A vehicle moves along its sides, radians.
ALONG = np.radians(40.0)
#: What no pair may cost.
NEVER = 1e6


@dataclass(eq=False)
class SeenTrack:
    """An object in several frames.

    Attributes:
        seen: of each frame in which it was.
        velocity: (2,) m/s when it was last seen; ``None`` where it was seen once.
    """

    seen: list[SeenObject]
    velocity: NDArray[np.float64] | None = None

    def cost(self, one: SeenObject, seconds: float) -> float:
        """Return how unlikely it is that this is the same object so much later, metres."""
        last = self.seen[-1]
        kind = one.detected_class
        if kind != last.detected_class:
            return NEVER
        way = one.middle - last.middle
        gone = float(np.linalg.norm(way))
        large = kind is None and max(one.diagonal, last.diagonal) > LARGE_M
        on_foot = kind == "pedestrian"
        if kind is None:
            on_foot = max(one.diagonal, last.diagonal) < PERSON_M
        most = DRIVES_M_S if large else WALKS_M_S if on_foot else RIDES_M_S
        if gone > most * seconds + ERROR_M or abs(one.diagonal - last.diagonal) > HIDDEN_M:
            return NEVER
        taller = abs(one.top - last.top)
        well = large and min(len(one.points), len(last.points)) >= WELL_SEEN
        outlines = {_outline(each) for each in (one, last)} - {None}
        if (
            abs(one.moves - last.moves) > SAME_SHARE
            or taller > (SAME_HEIGHT_M if well else TALLER_M)
            or (len(outlines) > 1 and gone > SAME_PLACE_M)
        ):
            return NEVER
        if large and gone > 2 * ERROR_M:
            heading = np.arctan2(way[1], way[0])
            for each in (one, last):
                off = abs(float(wrapped(2 * (heading - each.long_way)))) / 2
                if each.diagonal > LARGE_M and off > ALONG:
                    return NEVER
        if self.velocity is None:
            return gone / 2 + abs(one.diagonal - last.diagonal) + taller
        off = float(np.linalg.norm(way - self.velocity * seconds))
        return off + taller if off < ACCELERATES * seconds**2 + 2 * ERROR_M else NEVER

    @property
    def stands(self) -> bool:
        """Whether it was last seen as a vehicle that stands in most frames."""
        return self.seen[-1].moves < STANDS and self.seen[-1].diagonal > LARGE_M

    def cost_standing(self, one: SeenObject) -> float:
        """Return how unlikely it is that this still stands there after a gap, metres."""
        last = self.seen[-1]
        gone = float(np.linalg.norm(one.middle - last.middle))
        off = abs(one.diagonal - last.diagonal) + abs(one.top - last.top)
        same = one.moves < STANDS and one.diagonal > LARGE_M
        return gone + off if same and max(gone, off) < SAME_M else NEVER

    def add(self, one: SeenObject, seconds: float) -> None:
        """Go on with what was seen of it so much later."""
        velocity = (one.middle - self.seen[-1].middle) / seconds
        # Frames that follow each other fast are averaged over some tenths of a second.
        share = min(1.0, 3 * seconds) if self.velocity is not None else 1.0
        before = self.velocity if self.velocity is not None else velocity
        self.velocity = before + share * (velocity - before)
        self.seen.append(one)


def _outline(one: SeenObject) -> str | None:
    """Return who somebody is by its outline, or that it is a vehicle; ``None`` for neither."""
    if one.silhouette is None and one.diagonal > LARGE_M:
        return "vehicle"
    return one.silhouette


def tracks_of(frames: Sequence[Sequence[SeenObject]], times: FrameTimes) -> list[SeenTrack]:
    """Return the tracks of objects, frame by frame; what was seen once is one, too.

    Nobody is followed over a gap, but vehicles that stand in most frames.

    Args:
        frames: the objects of each.
        times: when they were taken.
    """
    done: list[SeenTrack] = []
    active: list[SeenTrack] = []
    at, group = times.time_s, times.group()
    for number, objects in enumerate(frames):
        followed, stood = list[SeenTrack](), list[SeenTrack]()
        for one in active:
            last = one.seen[-1].frame
            here = group[last] == group[number]
            kept = number - last <= LOST + 1 and (here or one.stands)
            (done if not kept else followed if here else stood).append(one)
        active = followed + stood
        taken = set[int]()
        if active and objects:
            since = [float(at[number] - at[one.seen[-1].frame]) for one in active]
            cost = np.array(
                [
                    *(
                        [one.cost(each, s) for each in objects]
                        for one, s in zip(followed, since, strict=False)
                    ),
                    *([one.cost_standing(each) for each in objects] for one in stood),
                ]
            )
            for row, column in zip(*linear_sum_assignment(cost), strict=True):
                if cost[row, column] < NEVER:
                    active[row].add(objects[column], since[row])
                    taken.add(int(column))
        active += [SeenTrack([one]) for k, one in enumerate(objects) if k not in taken]
    return done + active
