"""The rig: its sensors on their mounts, and where they are in a frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from urbantwin.geometry import Pose
from urbantwin.lidar.actor_path import ActorPath
from urbantwin.lidar.background import MeasuredBackground
from urbantwin.lidar.sensor import Sensor
from urbantwin.lidar.sensor_path import (
    FixedPath,
    MisplacedPath,
    RidingPath,
    SensorPath,
    SwayingPath,
)
from urbantwin.site.rig import (
    Calibration,
    Conditions,
    Effects,
    OutageSpec,
    PoseErrorSpec,
    RideSpec,
    SwaySpec,
)
from urbantwin.taxonomy import BoxKind

__all__ = ["MountedSensor", "ReturnMode", "Rig", "dataset_frame"]

#: Which echoes of a beam a sensor reports.
ReturnMode = Literal["strongest", "last", "first", "dual"]


@dataclass(frozen=True, eq=False)
class MountedSensor:
    """A sensor on the site or on a vehicle.

    Attributes:
        name: unique in the rig.
        sensor: its entry in the catalogue.
        columns: firings per turn.
        site_SE3_sensor: its pose while nothing moves it; of a sensor that rides, its pose if its
            carrier's mesh stood at the origin.
        effects: which imperfections it has.
        rate_hz: frames per second.
        number: of the sensor in its rig: what random numbers and labels know it by.
        turns_per_second: how fast it turns.
        frame_window_s: a frame holds the turns that arrive in so many seconds from its time on.
        phase_deg: encoder angle at which its turns begin, the way it turns.
        phase_lock: whether turns begin at whole multiples of their duration.
        clock_offset_s: what its clock is ahead of true time at the motion's start.
        clock_drift_ppm: how much too fast its clock runs, millionths.
        framed_by_clock: whether a frame holds the turns whose begin, by the sensor's clock, is in
            it; else those that arrive in it.
        time_jitter_s: standard deviation of a turn's start.
        latency_s: from a turn's end to its arrival.
        dropped_frames: share of its turns that never arrive.
        returns: which echoes of a beam it reports.
        outages: what of it does not work, and when.
        sway: how its pole swings; ``None``: not at all.
        swings_with: number of the sensor whose pole it shares.
        sway_height_m: height of the sensor above the foot of its pole.
        pose_error: how wrong its pose is reported; ``None``: it is right.
        carrier_SE3_sensor: its pose in the frame of its carrier's mesh; ``None``: it stands.
        above_roof_m: height above its carrier's top, where that is what was said: the carrier's
            own height comes to it when the rig boards.
        deskew: whether points of a sensor that rides are corrected for its motion, and not left as
            if it had stood still since the frame's time.
        calibration: how this unit differs from its datasheet.
        reflectivity: times what the table of materials says that they send back, by name.
        measured: what a real one found of the static world, to be seen in its place.
    """

    name: str
    sensor: Sensor
    columns: int
    site_SE3_sensor: Pose  # noqa: N815
    effects: Effects
    rate_hz: float = 10.0
    number: int = 0
    turns_per_second: float = 10.0
    frame_window_s: float = 0.1
    phase_deg: float = 0.0
    phase_lock: bool = True
    clock_offset_s: float = 0.0
    clock_drift_ppm: float = 0.0
    framed_by_clock: bool = False
    time_jitter_s: float = 0.0
    latency_s: float = 0.0
    dropped_frames: float = 0.0
    returns: ReturnMode = "strongest"
    outages: tuple[OutageSpec, ...] = ()
    sway: SwaySpec | None = None
    swings_with: int = 0
    sway_height_m: float = 5.0
    pose_error: PoseErrorSpec | None = None
    carrier_SE3_sensor: Pose | None = None  # noqa: N815
    above_roof_m: float | None = None
    deskew: bool = True
    calibration: Calibration = field(default_factory=Calibration)
    reflectivity: Mapping[str, float] = field(default_factory=dict)
    measured: MeasuredBackground | None = None

    @property
    def missing(self) -> float:
        """The share of beams that return nothing, whatever they meet."""
        return self.calibration.missing if self.effects.dropout else 0.0

    def path(self, frame_index: int, seed: int, carrier: ActorPath | None = None) -> SensorPath:
        """Return where the sensor is in the course of a frame.

        Args:
            frame_index: the frame's number.
            seed: of all random numbers.
            carrier: the path of the actor that carries it, of a sensor that rides.
        """
        path = self._believed_path(frame_index, seed, carrier)
        if self.pose_error is None:
            return path
        time_s = frame_index / self.rate_hz
        return MisplacedPath(path, self.pose_error, time_s, seed, self.number)

    def _believed_path(self, frame_index: int, seed: int, carrier: ActorPath | None) -> SensorPath:
        """Return its path where nothing but sway is unknown of it."""
        if self.carrier_SE3_sensor is not None:
            if carrier is None:
                raise ValueError(f"{self.name} rides, and nothing carries it")
            return RidingPath(carrier, self.carrier_SE3_sensor, self.deskew)
        if self.sway is not None:
            return SwayingPath(
                self.site_SE3_sensor,
                self.sway,
                self.sway_height_m,
                frame_index / self.rate_hz,
                seed,
                self.swings_with,
            )
        return FixedPath(self.site_SE3_sensor)


@dataclass(frozen=True, eq=False)
class Rig:
    """The sensors that record together and the frame that their points are fused in.

    Attributes:
        sensors: in the order of the rig's file; their numbers in labels are 0, 1, 2, ...
        frame: ``sensor``: that of the first sensor; ``level``: the first sensor's position and
            heading, with z against gravity; ``site``: the site frame.
        rate_hz: frames per second.
        dataset_SE3_site: takes points of the site frame to that frame, of a rig that stands.
        conditions: the weather and the sun.
        ride: the actor that was asked to carry it; ``None``: it stands.
        carrier: the track of the actor that carries it, once that is known.
        fused: whether a frame holds the points of all sensors; else each has a dataset.
        boxes: ``track``: a label has the size of its actor's track, where it is known; ``tight``:
            the bounds of the mesh at its moment; else whose annotators draw it, see
            `traffic.assets.annotators`.
        label_range_m: who is farther from every sensor in plan does not count; ``None``: whoever is
            in reach does.
    """

    sensors: tuple[MountedSensor, ...]
    frame: Literal["sensor", "level", "site"]
    rate_hz: float
    dataset_SE3_site: Pose  # noqa: N815
    conditions: Conditions = field(default_factory=Conditions)
    ride: RideSpec | None = None
    carrier: int | None = None
    fused: bool = True
    boxes: BoxKind = "track"
    label_range_m: float | None = None

    def dataset_pose(self, carrier: ActorPath | None = None) -> Pose:
        """Return ``dataset_SE3_site`` of a frame: of a rig that rides, it moves with its carrier.

        Args:
            carrier: the path of the actor that carries the rig, seconds from the frame's time.
        """
        mounted = self.sensors[0].carrier_SE3_sensor
        if carrier is None or mounted is None:
            return self.dataset_SE3_site
        return dataset_frame(self.frame, carrier.at(0.0) @ mounted).inverse()

    def separate(self) -> tuple[Rig, ...]:
        """Return a rig for each sensor, with its own frame; each records what it would together.

        The sensors keep their numbers, and with them their random numbers and poles.
        """
        return tuple(
            replace(
                self,
                sensors=(one,),
                dataset_SE3_site=dataset_frame(self.frame, one.site_SE3_sensor).inverse(),
                fused=True,
            )
            for one in self.sensors
        )


def dataset_frame(frame: Literal["sensor", "level", "site"], site_SE3_sensor: Pose) -> Pose:
    """Return the frame that points are given in (to the site's), of the first sensor's pose."""
    if frame == "sensor":
        return site_SE3_sensor
    if frame == "site":
        return Pose.from_ypr(np.zeros(3))
    ahead, up = site_SE3_sensor.rotation[:, 0], site_SE3_sensor.rotation[:, 2]
    if np.hypot(ahead[0], ahead[1]) < 1e-9:  # It looks straight down, or up.
        ahead = -np.sign(ahead[2]) * up
    return Pose.from_ypr(site_SE3_sensor.translation, float(np.arctan2(ahead[1], ahead[0])))
