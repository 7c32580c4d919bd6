"""Class, size and boxes of one observed actor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import wrapped
from urbantwin.traffic.observed.box_fit import SeenObject, extents, fitted_yaw
from urbantwin.traffic.observed.lanes_beneath import LanesBeneath

__all__ = ["ObservedTrack", "observed_track"]

#: Speed below which the direction of motion does not give the heading, m/s.
CREEPS_M_S = 1.5
#: Speed below which a pedestrian stands, m/s.
STEPS_M_S = 0.5
#: Depth across the longer side from which a pedestrian is in stride, metres: in UrbanTwin's
#: simulation a tenth of standing ones are nearly as deep, and half of the walking ones. Length of a
#: pedestrian in stride, metres.
DEEP_M, STRIDES_M = 0.35, 0.75
#: Maximum speed of pedestrians, m/s.
WALKS_M_S = 2.6
#: Usual length and width, metres, which complete objects seen from one side.
USUAL = {
    "car": (4.3, 1.8), "van": (5.2, 1.95), "truck": (8.0, 2.4), "bus": (12.0, 2.5),
    "bicycle": (1.75, 0.6), "pedestrian": (0.6, 0.6),
}  # fmt: skip
#: Range of lengths of vehicles with visible ends; others are parts, or two vehicles, metres.
LENGTHS = {"car": (3.2, 5.3), "van": (4.2, 7.0)}
#: Maximum width without mirrors, metres: the widest of the catalogue's cars and vans; trucks and
#: buses by law (Directive 96/53/EC). Sensors that are not synchronised see turning vehicles twice.
WIDEST = {"car": 2.05, "van": 2.2, "truck": 2.55, "bus": 2.55}
#: A flank is visible if this many points within this distance of it, metres, span this share of the
#: length.
FLANK_POINTS, FLANK_M, FLANK = 10, 0.3, 0.7
#: Share of the usual width below which an object is only partly visible.
WHOLE = 0.75
#: Maximum width and length of pedestrians and bicycles, metres.
WIDE_M, LONG_M = 1.3, 2.3
#: Maximum length of pedestrians, metres; and at any speed, since riders have more visible length.
RIDDEN_M, STRIDE_M = 1.35, 1.0
#: Least width of a static object that is a waiting vehicle, metres.
WAITS_M = 1.4
#: Maximum difference of the fitted heading from the lane's, and from the direction of motion,
#: radians.
OFF, TURNS = np.radians(12.0), np.radians(25.0)
#: Classes without lanes of their own; maximum height of their lowest points, metres.
SMALL = ("pedestrian", "bicycle")
OFF_GROUND_M = 0.9
#: Diagonal from which an object follows lanes, metres.
LANE_M = 1.5
#: Least displacement, metres; less is a post with varying visible parts.
GONE_M = 0.8
#: Share of moving points from which the displacement does not matter; height range of people,
#: metres.
SURELY, SHORT_M, TALL_M = 0.9, 1.0, 2.15
#: Least length of a vehicle beside all lanes, metres.
CLEAR_M = 3.0


@dataclass(frozen=True, eq=False)
class ObservedTrack:
    """An observed actor.

    Attributes:
        actor_class: class of the taxonomy.
        frames: (N,) numbers of the frames.
        boxes: (N, 3) x, y of the centre, metres, and yaw, radians.
        size: length, width, height, metres.
        speed: median speed, m/s; 0 if it was seen once.
        moves: whether it moves at all.
    """

    actor_class: str
    frames: NDArray[np.int64]
    boxes: NDArray[np.float64]
    size: tuple[float, float, float]
    speed: float
    moves: bool


def observed_track(
    seen: Sequence[SeenObject],
    lanes: LanesBeneath | None,
    time_s: NDArray[np.float64],
    *,
    small: bool = True,
) -> ObservedTrack | None:
    """Return an actor; ``None`` if the object is none, such as a post or leaves.

    Args:
        seen: its detections, in order.
        lanes: the lanes below.
        time_s: (N,) times of all frames, seconds.
        small: classify pedestrians and riders by size; else only the detector's actors are such.
    """
    frames = np.array([item.frame for item in seen])
    middles = np.array([item.middle for item in seen])
    velocity = _velocities(time_s[frames], middles)
    moving = float(np.mean([item.moves for item in seen]))
    moves = moving > 0.5
    if seen[0].actor is not None:
        return _detected_track(seen, frames, velocity) if moves else None
    top = float(np.median([item.top for item in seen]))
    speeds = np.linalg.norm(velocity, axis=1)
    speed = float(np.median(speeds))
    yaws = _headings(seen, middles, velocity, lanes)
    low, high = (
        np.array(each)
        for each in zip(
            *(extents(item.points, yaw) for item, yaw in zip(seen, yaws, strict=True)), strict=True
        )
    )
    spans = high - low
    length, width = np.quantile(spans, 0.75, axis=0)
    whole = np.array([_both_flanks(item, yaw) for item, yaw in zip(seen, yaws, strict=True)])
    on_lane = lanes is not None and bool(lanes.cover(middles).mean() > 0.5)
    outlines = [item.silhouette for item in seen if item.silhouette is not None]
    rides = outlines.count("bicycle") > len(outlines) / 2
    if len(outlines) > len(seen) / 2 and (moves or (rides and on_lane)):
        name: str | None = "bicycle" if rides else "pedestrian"
    else:
        name = _class(float(length), float(width), top, speed, on_lane=on_lane, moves=moves)
    moved_m = float(np.linalg.norm(middles[-1] - middles[0]))
    if name in SMALL and (
        not small
        or (moved_m < GONE_M and moving < SURELY and "bicycle" not in outlines)
        or min(item.bottom for item in seen) > OFF_GROUND_M
        or not SHORT_M < top < TALL_M
    ):
        return None
    if lanes is not None and not on_lane and name not in SMALL and length < CLEAR_M:
        return None
    if name is None:
        return None
    usual = USUAL[name]
    # For people the expected height above the highest ring is included, so that the median is
    # unbiased.
    height = float(np.quantile([item.highest for item in seen], 0.5 if name in SMALL else 0.75))
    if whole.any():
        # The median of these frames, which show both flanks; sensors that are not synchronised see
        # a moving vehicle at several places.
        width = np.median(spans[whole, 1])
    if not whole.any() or width < WHOLE * usual[1]:
        width = max(width, usual[1])
    width = min(width, WIDEST.get(name, width))
    ended = [item.length for item in seen if item.length is not None]
    if ended and name in LENGTHS:
        # Both have the same error, a quarter of a metre.
        length = (np.clip(np.median(ended), *LENGTHS[name]) + usual[0]) / 2
    else:
        length = max(length, usual[0])
    size = (float(length), float(width), height)
    if name in SMALL:
        strides = name == "pedestrian" and len(seen) == 1 and _is_in_stride(seen[0])
        size = (STRIDES_M if strides else usual[0], usual[1], height)
    if name == "pedestrian":
        yaws = [_pedestrian_heading(item, step) for item, step in zip(seen, velocity, strict=True)]
    boxes = np.array([_full_box(item, yaw, size) for item, yaw in zip(seen, yaws, strict=True)])
    return ObservedTrack(name, frames, boxes, size, speed if moves else 0.0, moves)


def _detected_track(
    seen: Sequence[SeenObject], frames: NDArray[np.int64], velocity: NDArray[np.float64]
) -> ObservedTrack:
    """Return an actor of a detector, with the observed height if plausible."""
    actors = [item.actor for item in seen if item.actor is not None]
    length, width, height = np.median([actor.size for actor in actors], axis=0)
    tall = float(np.median([item.highest for item in seen]))
    if SHORT_M < tall < TALL_M:
        height = tall
    name = actors[0].actor_class
    speed = float(np.median(np.linalg.norm(velocity, axis=1)))
    if name == "pedestrian":
        yaws = np.array(
            [_pedestrian_heading(item, step) for item, step in zip(seen, velocity, strict=True)]
        )
    else:
        rides = np.hypot(*velocity.T) >= CREEPS_M_S
        direction = np.arctan2(velocity[:, 1], velocity[:, 0])
        yaws = np.where(rides, direction, [actor.yaw for actor in actors])
    boxes = np.column_stack([[actor.place for actor in actors], yaws])
    size = (float(length), float(width), float(height))
    return ObservedTrack(name, frames, boxes, size, speed, moves=True)


def _class(
    length: float, width: float, top: float, speed: float, *, on_lane: bool, moves: bool
) -> str | None:
    if not moves and not (on_lane and width >= WAITS_M):
        return None
    if width < WIDE_M and length < LONG_M and top < 2.3:
        if not moves:
            return None
        walks = length < (RIDDEN_M if speed < WALKS_M_S else STRIDE_M)
        return "pedestrian" if walks else "bicycle"
    if top > 2.6 and length > 7.0:
        return "bus" if length > 9.0 else "truck"
    if top > 2.4:
        return "truck" if length > 6.2 else "van"
    return "van" if top > 1.95 else "car"


def _headings(
    seen: Sequence[SeenObject],
    middles: NDArray[np.float64],
    velocity: NDArray[np.float64],
    lanes: LanesBeneath | None,
) -> list[float]:
    """Return the heading in each frame, radians."""
    headings: list[float] = []
    for item, middle, (east, north) in zip(seen, middles, velocity, strict=True):
        moves = np.hypot(east, north) >= CREEPS_M_S
        direction = float(np.arctan2(north, east)) if moves else None
        lane = None
        if lanes is not None and item.diagonal > LANE_M:
            lane = lanes.lane_heading(middle, item.long_way if direction is None else direction)
        if lane is not None:
            # Consecutive samples may be different vehicles; a lane has one direction.
            headings.append(_nearest_side(item, lane, TURNS if direction is not None else OFF))
        elif direction is not None:
            headings.append(_nearest_side(item, direction, TURNS))
        else:
            headings.append(headings[-1] if headings else item.long_way)
    return headings


def _pedestrian_heading(one: SeenObject, velocity: NDArray[np.float64]) -> float:
    """Return a pedestrian's heading, radians: the direction of motion, else across the shoulders.

    Points do not distinguish chest and back.
    """
    if np.hypot(*velocity) >= STEPS_M_S:
        return float(np.arctan2(velocity[1], velocity[0]))
    return one.long_way + np.pi / 2


def _is_in_stride(one: SeenObject) -> bool:
    """Return whether a pedestrian is in stride: deeper in plan than any trunk."""
    low, high = extents(one.points, one.long_way)
    return bool((high - low)[1] >= DEEP_M)


def _nearest_side(one: SeenObject, way: float, within: float) -> float:
    """Return the fitted heading nearest to a direction, or one fitted within a range of it."""
    quarter = one.yaw + np.pi / 2 * np.arange(4.0, dtype=np.float64)
    gap: NDArray[np.float64] = np.asarray(quarter - way, np.float64)
    off = np.abs(wrapped(gap))
    nearest_yaw = float(quarter[off.argmin()])
    return nearest_yaw if off.min() < within else fitted_yaw(one.points, way, within)


def _velocities(times: NDArray[np.float64], places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return velocities (N, 2), m/s, by central differences."""
    if len(times) < 2:
        return np.zeros_like(places)
    return np.asarray(np.gradient(places, times, axis=0))


def _both_flanks(one: SeenObject, yaw: float) -> bool:
    """Return whether both flanks of an object are visible, or all of its front or its rear.

    A flank is visible if points lie along it; otherwise they lie only at a corner. Ends are not
    tested: if an object hides a part of a car, bonnet or roof look like an end.
    """
    c, s = np.cos(yaw), np.sin(yaw)
    along, across = (one.points @ np.array([[c, -s], [s, c]])).T
    low, high = extents(one.points, yaw)
    needed = FLANK * (high - low)[0]
    flanks = (across < low[1] + FLANK_M, across > high[1] - FLANK_M)
    return all(
        on_flank.sum() >= FLANK_POINTS and np.ptp(along[on_flank]) > needed for on_flank in flanks
    )


def _full_box(one: SeenObject, yaw: float, size: tuple[float, float, float]) -> NDArray[np.float64]:
    """Return x, y and yaw of the full box, whose sides towards the sensor are the visible ones."""
    low, high = extents(one.points, yaw)
    c, s = np.cos(yaw), np.sin(yaw)
    turn = np.array([[c, -s], [s, c]])
    to_sensor = (one.sensor @ turn) - (low + high) / 2
    half = np.array(size[:2]) / 2
    middle = np.where(to_sensor > 0, high - half, low + half)
    wide = high - low >= 2 * half
    middle = np.where(wide, (low + high) / 2, middle)
    return np.array([*(turn @ middle), yaw])
