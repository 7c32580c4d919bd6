"""Who drives, rides and walks in frames without labels.

Objects of each frame (`clusters`), followed from frame to frame (`association`), become boxes of
one size (`observed_track`). What stands in every frame is nobody's track: without a twin no vehicle
that waits; with one, what stands on its lanes and is as large as a vehicle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.progress import Progress, between, each, untold
from urbantwin.reconstruct.recording import Looks, RecordedFrame, RecordedFrames
from urbantwin.reconstruct.recording.recorded_ground import RecordedGround, recorded_ground
from urbantwin.roads import RoadNetwork
from urbantwin.traffic.observed.association import tracks_of
from urbantwin.traffic.observed.box_fit import SeenObject, fitted_yaw, highest
from urbantwin.traffic.observed.clusters import clusters
from urbantwin.traffic.observed.lanes_beneath import LanesBeneath
from urbantwin.traffic.observed.looked_through import looked_through, parts_in_sight
from urbantwin.traffic.observed.observed_track import ObservedTrack, observed_track

__all__ = ["Observation", "observe"]

#: Heights above the ground between which objects are looked for, metres.
LOW_M, HIGH_M = 0.3, 4.5
#: So many points of what stands, a frame, tell where the ground is.
GROUND_POINTS = 60_000
#: What stands on lanes and rises less than this is no vehicle, metres.
LEAST_TOP_M = 0.9


@dataclass(frozen=True, eq=False)
class Observation:
    """What was seen to move, or to wait on lanes.

    Attributes:
        tracks: of each, numbered from 1 in this order.
        ground: of the place.
        trails: (N, 3) points that move, and the number of their frame.
        frames: how many frames.
    """

    tracks: tuple[ObservedTrack, ...]
    ground: RecordedGround
    trails: NDArray[np.float64]
    frames: int


def observe(
    frames: RecordedFrames,
    network: RoadNetwork | None = None,
    *,
    rate_hz: float = 10.0,
    tell: Progress = untold,
) -> Observation:
    """Return what moves in frames, and what waits on lanes.

    Args:
        frames: of sensors that stand still.
        network: the place's lanes in the frame of the points; without it nobody is seen who stands
            in every frame.
        rate_hz: frames per second.
        tell: called with the share done and what is being done.

    Raises:
        InputError: there are too few frames, or a file cannot be read.
    """
    looks = Looks(frames, between(tell, 0.0, 0.5))
    still = [~looks.moving(frames.read(k)) for k in range(len(frames))]
    share = max(1, sum(int(one.sum()) for one in still) // (GROUND_POINTS * 12))
    ground = recorded_ground(
        np.concatenate([frames.read(k).points[one][::share] for k, one in enumerate(still)])
    )
    lanes = LanesBeneath(network) if network is not None else None
    places = np.array([sensor.place[:2] for sensor in frames.sensors])
    objects, trails = [], []
    for number in each(range(len(frames)), between(tell, 0.5, 0.9), "objects"):
        frame = frames.read(number)
        found, moving = _objects(number, frame, ~still[number], ground, lanes, places)
        objects.append(found)
        trails.append(moving)
    tell(0.9, "tracks")
    stand = np.array([sensor.place for sensor in frames.sensors])

    def nobody(number: int, place: NDArray[np.float64]) -> bool:
        height = -float(ground.above(np.array([[*place, 0.0]]))[0])
        return looked_through(frames.read(number), stand, place, height)

    tracks = [
        observed_track(part.seen, lanes, rate_hz)
        for one in tracks_of(objects, rate_hz)
        for part in parts_in_sight(one, nobody)
    ]
    kept = [one for one in tracks if one is not None]
    return Observation(
        tuple(sorted(kept, key=lambda one: (one.frames[0], tuple(one.boxes[0])))),
        ground,
        np.concatenate(trails),
        len(frames),
    )


def _objects(
    number: int,
    frame: RecordedFrame,
    moves: NDArray[np.bool_],
    ground: RecordedGround,
    lanes: LanesBeneath | None,
    sensors: NDArray[np.float64],
) -> tuple[list[SeenObject], NDArray[np.float64]]:
    """Return a frame's objects, and (N, 3) place and frame of what moves."""
    above = ground.above(frame.points)
    kept = (above > LOW_M) & (above < HIGH_M)
    trail = frame.points[kept & moves]
    if lanes is not None:
        kept[kept] = moves[kept] | lanes.cover(frame.points[kept])
    else:
        kept &= moves
    points, above, moves = frame.points[kept], above[kept], moves[kept]
    sensor = frame.sensor[kept]
    found = []
    for rows in clusters(points, above):
        top = float(np.quantile(above[rows], 0.98))
        share = float(moves[rows].mean())
        if top < LEAST_TOP_M:
            continue
        of = np.bincount(np.maximum(sensor[rows], 0), minlength=len(sensors))
        plan = points[rows, :2]
        found.append(
            SeenObject(
                number,
                plan,
                top,
                highest(above[rows]),
                float(np.quantile(above[rows], 0.02)),
                sensors[int(of.argmax())],
                share,
                fitted_yaw(plan),
            )
        )
    return found, np.column_stack([trail[:, :2], np.full(len(trail), float(number))])
