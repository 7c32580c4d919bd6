"""Observation of vehicles, riders and pedestrians in unlabelled frames.

Objects of each frame (`clusters`), associated from frame to frame (`association`), become boxes of
constant size (`observed_track`). Objects that are static in every frame have no track: without a
twin no waiting vehicle is found; with one, static objects of a vehicle's size on its lanes are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from urbantwin.progress import Progress, between, each, untold
from urbantwin.reconstruct.recording import Looks, RecordedFrame, RecordedFrames
from urbantwin.reconstruct.recording.recorded_ground import RecordedGround, recorded_ground
from urbantwin.roads import RoadNetwork
from urbantwin.traffic.observed.association import LARGE_M, tracks_of
from urbantwin.traffic.observed.box_fit import (
    DetectedActor,
    SeenObject,
    beneath_gap,
    fitted_yaw,
    highest,
    unseen_above,
    with_points,
)
from urbantwin.traffic.observed.clusters import clusters
from urbantwin.traffic.observed.frame_times import FrameTimes
from urbantwin.traffic.observed.lanes_beneath import LanesBeneath
from urbantwin.traffic.observed.looked_through import looked_through, parts_in_sight, seen_length
from urbantwin.traffic.observed.observed_track import ObservedTrack, observed_track
from urbantwin.traffic.observed.silhouette import apart, silhouette
from urbantwin.traffic.observed.spacing import found_times

__all__ = ["Observation", "observe"]

#: Range of heights above the ground in which objects are detected, metres.
LOW_M, HIGH_M = 0.3, 4.5
#: Number of static points per frame from which the ground is estimated.
GROUND_POINTS = 60_000
#: Least height of a static vehicle on a lane, metres.
LEAST_TOP_M = 0.9


@dataclass(frozen=True, eq=False)
class Observation:
    """Moving objects, and waiting ones on lanes.

    Attributes:
        tracks: the tracks, numbered from 1 in this order.
        ground: the ground.
        trails: (N, 3) x, y of moving points, and the number of their frame.
        times: times of the frames.
    """

    tracks: tuple[ObservedTrack, ...]
    ground: RecordedGround
    trails: NDArray[np.float64]
    times: FrameTimes

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.times.time_s)


def observe(
    frames: RecordedFrames,
    network: RoadNetwork | None = None,
    *,
    detected: Sequence[Sequence[DetectedActor]] | None = None,
    rate_hz: float = 10.0,
    times: FrameTimes | None = None,
    tell: Progress = untold,
) -> Observation:
    """Return the moving objects of frames, and the waiting ones on lanes.

    Args:
        frames: frames of stationary sensors.
        network: the lanes in the frame of the points; ``None``: objects static in every frame are
            not found.
        detected: pedestrians and riders of a detector in each frame; ``None``: objects of their
            size are taken for them.
        rate_hz: frame rate without gaps; gaps are detected (`spacing`).
        times: times of the frames, which replace the detection of gaps.
        tell: called with the fraction done and what is being done.

    Raises:
        InputError: there are too few frames, their sensors moved, or a file cannot be read.
    """
    looks = Looks(frames, between(tell, 0.0, 0.5))
    looks.check_standing()
    still = [~looks.moving(frames.read(k)) for k in range(len(frames))]
    share = max(1, sum(int(is_still.sum()) for is_still in still) // (GROUND_POINTS * 12))
    ground = recorded_ground(
        np.concatenate(
            [frames.read(k).points[is_still][::share] for k, is_still in enumerate(still)]
        )
    )
    lanes = LanesBeneath(network) if network is not None else None
    stand = np.array([sensor.place for sensor in frames.sensors])
    objects, trails = [], []
    for number in each(range(len(frames)), between(tell, 0.5, 0.9), "objects"):
        frame = frames.read(number)
        boxes = detected[number] if detected is not None else None
        seen_objects, moving = _objects(number, frame, ~still[number], ground, lanes, stand, boxes)
        objects.append(seen_objects)
        trails.append(moving)
    tell(0.9, "tracks")

    def nobody(number: int, place: NDArray[np.float64]) -> bool:
        return looked_through(frames.read(number), stand, place, _height(ground, place))

    if times is None:
        times = found_times(objects, rate_hz)
    tracks = [
        observed_track(part.seen, lanes, times.time_s, small=detected is None)
        for track in tracks_of(objects, times)
        for part in parts_in_sight(track, nobody)
    ]
    actors = [track for track in tracks if track is not None]
    return Observation(
        tuple(sorted(actors, key=lambda track: (track.frames[0], tuple(track.boxes[0])))),
        ground,
        np.concatenate(trails),
        times,
    )


def _objects(
    number: int,
    frame: RecordedFrame,
    moves: NDArray[np.bool_],
    ground: RecordedGround,
    lanes: LanesBeneath | None,
    sensors: NDArray[np.float64],
    detected: Sequence[DetectedActor] | None,
) -> tuple[list[SeenObject], NDArray[np.float64]]:
    """Return a frame's objects, and (N, 3) x, y and frame of its moving points."""
    above = ground.above(frame.points)
    rises = np.flatnonzero((above > LOW_M) & (above < HIGH_M))
    trail = frame.points[rises[moves[rises]]]

    def seen(rows: NDArray[np.intp], actor: DetectedActor | None = None) -> SeenObject:
        of = np.bincount(np.maximum(frame.sensor[rows], 0), minlength=len(sensors))
        most = int(of.argmax())
        plan = frame.points[rows, :2]
        heights = beneath_gap(above[rows])
        yaw = fitted_yaw(plan)
        item = SeenObject(
            number,
            plan,
            float(np.quantile(heights, 0.98)),
            highest(heights),
            float(np.quantile(above[rows], 0.02)),
            sensors[most, :2],
            float(moves[rows].mean()),
            yaw,
            actor,
            silhouette(plan, above[rows], yaw) if detected is None else None,
        )
        if actor is not None or item.diagonal <= LARGE_M:
            over = unseen_above(above[rows], frame.sensor[rows], frame.ring[rows], item.highest)
            return replace(item, highest=item.highest + over)
        own, below = plan[frame.sensor[rows] == most], _height(ground, item.middle)
        return replace(item, length=seen_length(own, item.long_way, frame, sensors, below))

    objects, in_box = [], np.zeros(len(above), np.bool_)
    for actor, rows in with_points(detected or (), frame.points[rises]):
        objects.append(seen(rises[rows], actor))
        in_box[rises[rows]] = True
    left = rises[~in_box[rises]]
    wanted = moves[left]
    if lanes is not None:
        wanted = wanted | lanes.cover(frame.points[left])
    left = left[wanted]
    for part in clusters(frame.points[left], above[left]):
        rows = left[part]
        group = apart(frame.points[rows, :2], above[rows]) if detected is None else []
        for own in group or [np.arange(len(rows))]:
            item = seen(rows[own])
            if item.top >= LEAST_TOP_M:
                objects.append(item)
    return objects, np.column_stack([trail[:, :2], np.full(len(trail), float(number))])


def _height(ground: RecordedGround, place: NDArray[np.float64]) -> float:
    """Return the height of the ground at a point (2,), metres."""
    return -float(ground.above(np.array([[*place, 0.0]]))[0])
