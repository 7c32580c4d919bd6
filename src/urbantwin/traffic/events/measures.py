"""Measures of a conflict between two actors: time to collision, post-encroachment time, gap.

- *Time to collision* (Hayward, Near-miss determination through use of a scale of danger, Highway
  Research Record 384, 1972; FHWA, Surrogate Safety Assessment Model, FHWA-HRT-08-051, 2008): the
  time until the two touch if both keep their velocities. Outlines are the boxes in plan with
  constant headings; the value of a conflict is the minimum over time.
- *Post-encroachment time* (Allen, Shin and Cooper, Analysis of traffic conflicts and collisions,
  Transportation Research Record 667, 1978): from the first actor leaving the area that both pass
  over to the second entering it; negative if both are in it at once.
- *Gap*: the distance between the boxes in plan; 0 if they touch.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

__all__ = [
    "Conflict",
    "Passage",
    "conflict",
    "corners_of",
    "gaps",
    "post_encroachment",
    "times_to_collision",
]

#: Time resolution for post-encroachment times, finer than the motion's steps, seconds.
_RESOLUTION_S = 0.01
#: Least size of an area that both pass over, square metres; less is a touch of corners.
_MIN_CONFLICT_AREA_M2 = 0.01


@dataclass(frozen=True, eq=False)
class Passage:
    """Motion of one actor's box in plan.

    Attributes:
        time_s: (N,) ascending times, seconds.
        xy: (N, 2) centre, metres.
        yaw: (N,) heading, rad.
        velocity: (N, 2) m/s.
        length: metres.
        width: metres.
    """

    time_s: NDArray[np.float64]
    xy: NDArray[np.float64]
    yaw: NDArray[np.float64]
    velocity: NDArray[np.float64]
    length: float
    width: float

    @classmethod
    def along(
        cls,
        time_s: NDArray[np.float64],
        xy: NDArray[np.float64],
        yaw: NDArray[np.float64],
        length: float,
        width: float,
    ) -> Passage:
        """Return a passage with velocities derived from its positions."""
        moving = np.gradient(xy, time_s, axis=0) if len(time_s) > 1 else np.zeros_like(xy)
        return cls(time_s, xy, yaw, moving, length, width)

    def between(self, start_s: float, stop_s: float) -> Passage:
        """Return the part between two times, both included."""
        in_span = (self.time_s >= start_s - 1e-6) & (self.time_s <= stop_s + 1e-6)
        return self.of_rows(in_span)

    def of_rows(self, rows: NDArray[np.bool_] | NDArray[np.intp]) -> Passage:
        """Return the passage at some of its times."""
        return Passage(
            self.time_s[rows],
            self.xy[rows],
            self.yaw[rows],
            self.velocity[rows],
            self.length,
            self.width,
        )

    def corners(self) -> NDArray[np.float64]:
        """Return the corners (N, 4, 2) of the boxes."""
        return corners_of(self.xy, self.yaw, self.length, self.width)

    def boxes(self) -> NDArray[np.object_]:
        """Return the boxes (N,) as polygons."""
        return np.asarray(shapely.polygons(self.corners()), object).reshape(-1)


def corners_of(
    xy: NDArray[np.float64],
    yaw: NDArray[np.float64],
    length: NDArray[np.float64] | float,
    width: NDArray[np.float64] | float,
) -> NDArray[np.float64]:
    """Return the corners (N, 4, 2) of boxes in plan.

    Args:
        xy: (N, 2) centres, metres.
        yaw: (N,) headings, rad.
        length: (N,) or one for all, metres.
        width: (N,) or one for all, metres.
    """
    half, half_width = (np.reshape(side, (-1, 1)) / 2 for side in (length, width))
    ahead = np.column_stack([np.cos(yaw), np.sin(yaw)]) * half
    left = np.column_stack([-np.sin(yaw), np.cos(yaw)]) * half_width
    offsets = [ahead + left, ahead - left, -ahead - left, -ahead + left]
    return np.stack([xy + corner for corner in offsets], axis=1)


@dataclass(frozen=True)
class Conflict:
    """Measures of a conflict between two actors.

    Attributes:
        ttc_s: least time to collision; ``None`` if they were never on a collision course.
        ttc_at_s: time of ``ttc_s``.
        pet_s: post-encroachment time; ``None`` if there is no area that both pass over.
        gap_m: smallest gap.
        gap_at_s: time of ``gap_m``.
    """

    ttc_s: float | None
    ttc_at_s: float | None
    pet_s: float | None
    gap_m: float
    gap_at_s: float

    def told(self) -> dict[str, float | None]:
        """Return the values for a manifest, rounded to milliseconds and millimetres."""
        values = {name: getattr(self, name) for name in self.__dataclass_fields__}
        return {name: None if value is None else round(value, 3) for name, value in values.items()}


def conflict(a: Passage, b: Passage) -> Conflict | None:
    """Return the measures of two actors' conflict; ``None`` if they never exist at the same time.

    The times of both are steps of the same motion.
    """
    _, first, second = np.intersect1d(
        np.round(a.time_s, 6), np.round(b.time_s, 6), return_indices=True
    )
    if not len(first):
        return None
    passage_a, passage_b = a.of_rows(first), b.of_rows(second)
    ttc, apart = times_to_collision(passage_a, passage_b), gaps(passage_a, passage_b)
    soonest, nearest = int(np.argmin(ttc)), int(np.argmin(apart))
    collides = bool(np.isfinite(ttc[soonest]))
    return Conflict(
        float(ttc[soonest]) if collides else None,
        float(passage_a.time_s[soonest]) if collides else None,
        post_encroachment(a, b),
        float(apart[nearest]),
        float(passage_a.time_s[nearest]),
    )


def gaps(a: Passage, b: Passage) -> NDArray[np.float64]:
    """Return the distance (N,) between the boxes at each time."""
    return np.asarray(shapely.distance(a.boxes(), b.boxes()), np.float64)


def times_to_collision(a: Passage, b: Passage) -> NDArray[np.float64]:
    """Return, at each time, the time (N,) until the boxes touch; ``inf`` for never.

    Two convex outlines in straight motion touch when their projections on the normals of all their
    sides overlap at once: from the latest begin to the earliest end of these overlaps.
    """
    corners_a, corners_b = a.corners(), b.corners()
    moving = a.velocity - b.velocity
    begins, ends = np.full(len(moving), -np.inf), np.full(len(moving), np.inf)
    for yaw in (a.yaw, a.yaw + np.pi / 2, b.yaw, b.yaw + np.pi / 2):
        axis = np.column_stack([np.cos(yaw), np.sin(yaw)])
        on_a = np.einsum("nkd,nd->nk", corners_a, axis)
        on_b = np.einsum("nkd,nd->nk", corners_b, axis)
        pace = np.einsum("nd,nd->n", moving, axis)
        gap_begin = on_b.min(axis=1) - on_a.max(axis=1)
        gap_end = on_b.max(axis=1) - on_a.min(axis=1)
        still = np.abs(pace) < 1e-9
        with np.errstate(divide="ignore", invalid="ignore"):
            times = np.sort(np.column_stack([gap_begin / pace, gap_end / pace]), axis=1)
        overlaps = (gap_begin <= 0) & (gap_end >= 0)
        low = np.where(still, np.where(overlaps, -np.inf, np.inf), times[:, 0])
        high = np.where(still, np.where(overlaps, np.inf, -np.inf), times[:, 1])
        begins, ends = np.maximum(begins, low), np.minimum(ends, high)
    touches = (begins <= ends) & (ends >= 0)
    return np.where(touches, np.maximum(begins, 0.0), np.inf)


def post_encroachment(a: Passage, b: Passage) -> float | None:
    """Return the post-encroachment time of two actors, seconds; see the module.

    If several areas are passed by both, the least time; ``None`` if there is none.
    """
    fine_a, fine_b = _resampled(a), _resampled(b)
    swept_a, swept_b = _swept(fine_a), _swept(fine_b)
    common = shapely.intersection(shapely.union_all(swept_a), shapely.union_all(swept_b))
    least: float | None = None
    for part in shapely.get_parts(common):
        if part.area < _MIN_CONFLICT_AREA_M2:
            continue
        shapely.prepare(part)
        stays = [_occupancy_times(passage, part) for passage in (fine_a, fine_b)]
        if stays[0] is None or stays[1] is None:
            continue
        (in_a, out_a), (in_b, out_b) = stays[0], stays[1]
        time_s = in_b - out_a if in_a <= in_b else in_a - out_b
        if least is None or time_s < least:
            least = time_s
    return least


def _occupancy_times(passage: Passage, area: shapely.Geometry) -> tuple[float, float] | None:
    """Return the times at which a box enters an area and leaves it; ``None`` if it never does."""
    # A box that only touches the border covers no part of the area.
    inside = np.flatnonzero(shapely.area(shapely.intersection(passage.boxes(), area)) > 1e-4)
    if not len(inside):
        return None
    return float(passage.time_s[inside[0]]), float(passage.time_s[inside[-1]])


def _resampled(passage: Passage) -> Passage:
    """Return the passage resampled to steps of ``_RESOLUTION_S``."""
    start, stop = passage.time_s[0], passage.time_s[-1]
    times = np.linspace(start, stop, max(round(float(stop - start) / _RESOLUTION_S), 0) + 1)
    columns = (*passage.xy.T, np.unwrap(passage.yaw), *passage.velocity.T)
    x, y, yaw, vx, vy = (np.interp(times, passage.time_s, column) for column in columns)
    moving = np.column_stack([vx, vy])
    return Passage(times, np.column_stack([x, y]), yaw, moving, passage.length, passage.width)


def _swept(passage: Passage) -> NDArray[np.object_]:
    """Return the areas that a box sweeps between consecutive times."""
    few = passage.of_rows(np.unique(np.linspace(0, len(passage.yaw) - 1, 400).astype(np.intp)))
    corners = few.corners()
    if len(corners) == 1:
        return few.boxes()
    pairs = np.concatenate([corners[:-1], corners[1:]], axis=1)
    return np.asarray(shapely.convex_hull(shapely.multipoints(pairs)), object)
