"""The rig: its sensors, their mounts, and their poses in a frame."""

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

#: Return mode: the echoes of a beam that a sensor reports.
ReturnMode = Literal["strongest", "last", "first", "dual"]


@dataclass(frozen=True, eq=False)
class MountedSensor:
    """A sensor on the site or on a vehicle.

    Attributes:
        name: unique name in the rig.
        sensor: catalogue entry.
        columns: firings per turn.
        site_SE3_sensor: pose at rest; for a sensor on a vehicle, its pose with the carrier's mesh
            at the site's origin.
        effects: measurement effects that are on.
        rate_hz: frames per second.
        number: index of the sensor in its rig, which keys random numbers and labels.
        turns_per_second: rotation rate.
        frame_window_s: a frame holds the turns that arrive within this time after the frame's,
            seconds.
        phase_deg: encoder angle at the start of a turn, in the direction of rotation.
        phase_lock: whether turns begin at whole multiples of their duration.
        clock_offset_s: offset of its clock from true time at the motion's start.
        clock_drift_ppm: drift of its clock, parts per million; positive runs fast.
        framed_by_clock: assign turns to frames by their start on the sensor's clock, not by
            arrival.
        time_jitter_s: standard deviation of a turn's start.
        latency_s: time from a turn's end to its arrival.
        dropped_frames: share of turns that are lost.
        returns: return mode.
        outages: parts that fail, and when.
        sway: motion of its pole; ``None`` for none.
        swings_with: index of the first sensor on the same pole.
        sway_height_m: height of the sensor above the foot of its pole.
        pose_error: error of the reported pose; ``None`` for none.
        carrier_SE3_sensor: pose in the frame of its carrier's mesh; ``None``: fixed to the site.
        above_roof_m: height above its carrier's roof, if given so; resolved when the carrier is
            known.
        deskew: whether points of a sensor on a vehicle are corrected for its motion within the
            frame.
        calibration: deviations of this unit from its datasheet.
        reflectivity: factors on the reflectivity of materials, by name.
        measured: measured background that replaces the modelled static world.
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
        """Share of beams that return nothing, whatever they hit."""
        return self.calibration.missing if self.effects.dropout else 0.0

    def path(self, frame_index: int, seed: int, carrier: ActorPath | None = None) -> SensorPath:
        """Return the path of the sensor over a frame.

        Args:
            frame_index: number of the frame.
            seed: random seed.
            carrier: path of the actor that carries the sensor, if any.
        """
        path = self._believed_path(frame_index, seed, carrier)
        if self.pose_error is None:
            return path
        time_s = frame_index / self.rate_hz
        return MisplacedPath(path, self.pose_error, time_s, seed, self.number)

    def _believed_path(self, frame_index: int, seed: int, carrier: ActorPath | None) -> SensorPath:
        """Return the path without errors of the reported pose."""
        if self.carrier_SE3_sensor is not None:
            if carrier is None:
                raise ValueError(f"{self.name} is mounted on a vehicle, and no carrier is given")
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
    """Sensors that record together, and the frame of their points.

    Attributes:
        sensors: in the order of the rig's file; labels number them 0, 1, 2, ...
        frame: ``sensor``: that of the first sensor; ``level``: position and heading of the first
            sensor, with z up; ``site``: the site frame.
        rate_hz: frames per second.
        dataset_SE3_site: from the site frame to that frame, for a fixed rig.
        conditions: weather and sun.
        ride: the requested carrier; ``None``: a fixed rig.
        carrier: track of the actor that carries it, once it is chosen.
        fused: whether a frame holds the points of all sensors; otherwise each has a dataset.
        boxes: size of labels: ``track``: that of the actor's track if known; ``tight``: bounds of
            the mesh in the frame; otherwise the dataset whose annotation rules apply, see
            `traffic.assets.annotators`.
        label_range_m: actors farther from every sensor (horizontally) do not count; ``None``: no
            limit.
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
        """Return ``dataset_SE3_site`` of a frame; on a vehicle it moves with the carrier.

        Args:
            carrier: path of the carrier, seconds relative to the frame's time.
        """
        mounted = self.sensors[0].carrier_SE3_sensor
        if carrier is None or mounted is None:
            return self.dataset_SE3_site
        return dataset_frame(self.frame, carrier.at(0.0) @ mounted).inverse()

    def separate(self) -> tuple[Rig, ...]:
        """Return one rig per sensor, each with its own frame, which records the same points.

        Sensors keep their index, and with it their random numbers and poles.
        """
        return tuple(
            replace(
                self,
                sensors=(mounted,),
                dataset_SE3_site=dataset_frame(self.frame, mounted.site_SE3_sensor).inverse(),
                fused=True,
            )
            for mounted in self.sensors
        )


def dataset_frame(frame: Literal["sensor", "level", "site"], site_SE3_sensor: Pose) -> Pose:
    """Return the pose of the frame of the points (to the site's), from the first sensor's pose."""
    if frame == "sensor":
        return site_SE3_sensor
    if frame == "site":
        return Pose.from_ypr(np.zeros(3))
    ahead, up = site_SE3_sensor.rotation[:, 0], site_SE3_sensor.rotation[:, 2]
    if np.hypot(ahead[0], ahead[1]) < 1e-9:  # the sensor points straight down or up
        ahead = -np.sign(ahead[2]) * up
    return Pose.from_ypr(site_SE3_sensor.translation, float(np.arctan2(ahead[1], ahead[0])))
