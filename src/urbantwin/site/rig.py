"""Sensor rig of a site: sensors, poses, timing and faults."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, ValidationInfo, field_validator, model_validator

from urbantwin.geometry import SiteFrame
from urbantwin.site.calibration import Calibration, Reflectivities
from urbantwin.site.conditions import Angle, Conditions, Effects, Strict
from urbantwin.site.sensor_pose import FARTHEST_M, SensorPlace
from urbantwin.site.yaml_document import Document, read_document, wrong
from urbantwin.taxonomy import ACTOR_CLASSES, BoxKind

__all__ = [
    "FARTHEST_M",
    "Calibration",
    "Conditions",
    "Effects",
    "OutageSpec",
    "PoseErrorSpec",
    "RideSpec",
    "RigSpec",
    "SensorSpec",
    "SwaySpec",
    "load_rig_spec",
    "rig_spec_from",
]

_MOST_CHANNELS = 65536


class OutageSpec(Strict):
    """An outage: beams without returns for a time. Fields not given do not restrict it.

    Attributes:
        sector_deg: two azimuths in the sensor's frame, degrees counter-clockwise from x: beams from
            the first counter-clockwise to the second; ``[150, -150]`` is 60 degrees at the rear.
        channels: channel numbers as in ``ring``, from 0; a file may also give ranges:
            ``["0-15", 20]``.
        start_s: start, time of the motion, seconds.
        stop_s: end, exclusive, seconds; ``None`` for no end.
    """

    sector_deg: Annotated[list[Angle], Field(min_length=2, max_length=2)] | None = None
    channels: (
        Annotated[list[Annotated[int, Field(ge=0, lt=_MOST_CHANNELS)]], Field(min_length=1)] | None
    ) = None
    start_s: Annotated[float, Field(ge=0.0, allow_inf_nan=False)] = 0.0
    stop_s: Annotated[float, Field(gt=0.0, allow_inf_nan=False)] | None = None

    @field_validator("channels", mode="before")
    @classmethod
    def _spans_of_channels(cls, value: Any) -> Any:  # noqa: ANN401
        if not isinstance(value, list):
            return value
        numbers: list[Any] = []
        for item in value:
            if not isinstance(item, str):
                numbers.append(item)
                continue
            first, dash, last = item.partition("-")
            if not (dash and first.strip().isdecimal() and last.strip().isdecimal()):
                raise wrong(f"{item!r:.40} is not a span of channels", "a number or '0-15'")
            low, high = int(first), int(last)
            if not low <= high < _MOST_CHANNELS:
                raise wrong(f"{item!r:.40} is not a span of channels", "a number or '0-15'")
            numbers += range(low, high + 1)
        return numbers

    @model_validator(mode="after")
    def _ends_after_it_starts(self) -> OutageSpec:
        if self.stop_s is not None and self.stop_s <= self.start_s:
            raise wrong(f"ends at {self.stop_s:g} s", f"more than its start_s, {self.start_s:g}")
        return self


Seconds = Annotated[float, Field(ge=-3600.0, le=3600.0, allow_inf_nan=False)]
Rate = Annotated[float, Field(gt=0.0, le=100.0, allow_inf_nan=False)]


class SwaySpec(Strict):
    """Sway of a sensor's pole in the wind.

    Attributes:
        rms_m: root mean square of the sensor's displacement in each horizontal direction, metres.
        frequency_hz: frequency of the pole's first mode, hertz.
        damping: fraction of the critical damping; smaller values give longer oscillation.
    """

    rms_m: Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)]
    frequency_hz: Annotated[float, Field(gt=0.0, le=50.0, allow_inf_nan=False)] = 1.5
    damping: Annotated[float, Field(gt=0.0, le=0.5, allow_inf_nan=False)] = 0.01


class PoseErrorSpec(Strict):
    """Error of a sensor's reported pose; the sensor itself does not move.

    Attributes:
        rms_m: root mean square of the wandering position error along east, north and up each,
            metres.
        rms_deg: root mean square of the wandering rotation error about each of these axes, degrees.
        memory_s: correlation time of the wandering errors, seconds.
        drift_m_per_min: drift of the position, in a random direction, metres per minute.
        drift_deg_per_min: drift of the attitude, about a random axis, degrees per minute.
    """

    rms_m: Annotated[float, Field(ge=0.0, le=10.0, allow_inf_nan=False)] = 0.0
    rms_deg: Annotated[float, Field(ge=0.0, le=30.0, allow_inf_nan=False)] = 0.0
    memory_s: Annotated[float, Field(ge=0.1, le=1e6, allow_inf_nan=False)] = 60.0
    drift_m_per_min: Annotated[float, Field(ge=0.0, le=60.0, allow_inf_nan=False)] = 0.0
    drift_deg_per_min: Annotated[float, Field(ge=0.0, le=360.0, allow_inf_nan=False)] = 0.0


class RideSpec(Strict):
    """Actor of the motion that carries the rig: a track, or one of a class.

    Attributes:
        track: the actor's track number in the motion.
        actor_class: written ``class``: one of ``taxonomy.ACTOR_CLASSES``. The actor of this class
            that is present longest in the recorded span carries the rig; of several, the one
            nearest to the anchor on average.
    """

    track: Annotated[int, Field(ge=1, le=0xFFFF)] | None = None
    actor_class: str | None = Field(default=None, alias="class")

    @field_validator("actor_class")
    @classmethod
    def _class_is_known(cls, value: str | None) -> str | None:
        if value is not None and value not in ACTOR_CLASSES:
            raise wrong(f"is {value!r:.40}", "one of " + ", ".join(ACTOR_CLASSES))
        return value

    @model_validator(mode="after")
    def _names_one(self) -> RideSpec:
        if (self.track is None) == (self.actor_class is None):
            raise wrong("does not name one carrier", "track: a number, or class: a class")
        return self


class _Named(Strict):
    name: Annotated[str, Field(description="a name, unique in the rig")]
    model: Annotated[str, Field(min_length=1, description="a sensor of the catalogue, or its file")]
    columns: Annotated[int, Field(gt=0, le=16384)] | None = None

    @field_validator("name")
    @classmethod
    def _name_is_plain(cls, value: str) -> str:
        if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}", value):
            raise wrong(f"{value!r} cannot name files", "letters, digits, '.', '_' and '-'")
        return value


class SensorSpec(SensorPlace, _Named):
    """A sensor: model, pose, timing and faults.

    Attributes:
        name: name, unique in the rig; used for columns and files.
        model: name in the sensor catalogue, or path of a sensor's file; checked when the rig is
            placed.
        columns: columns per turn; ``None`` for the model's default.
        proposed: whether its position is a proposal, which a build may improve.
        effects: its measurement effects, on unless turned off.
        returns: reported echoes of a beam; ``None`` for the strongest, if the model offers it.
        rate_hz: turns per second; ``None`` for the rig's frame rate.
        phase_deg: encoder angle at the frames' times, degrees in the direction of rotation.
        phase_lock: whether that phase is kept; otherwise turns start at any phase and drift with
            its clock.
        clock_offset_s: offset of its clock ahead of true time at the motion's start, seconds.
        clock_drift_ppm: excess rate of its clock, ppm.
        time_jitter_s: standard deviation of a turn's start, seconds.
        latency_s: latency from a turn's end to its arrival, seconds.
        dropped_frames: fraction of lost frames.
        outages: outages of its beams.
        calibration: deviations of this unit from the datasheet.
        sway: sway of its own pole; ``None`` for the rig's.
        pose_error: error of its reported pose; ``None`` for none.
    """

    proposed: bool | None = None
    effects: Effects = Effects()
    returns: Literal["strongest", "last", "first", "dual"] | None = None
    rate_hz: Rate | None = None
    phase_deg: Annotated[float, Field(ge=-360.0, le=360.0, allow_inf_nan=False)] = 0.0
    phase_lock: bool = True
    clock_offset_s: Seconds = 0.0
    clock_drift_ppm: Annotated[float, Field(ge=-10000.0, le=10000.0, allow_inf_nan=False)] = 0.0
    time_jitter_s: Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)] = 0.0
    latency_s: Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)] = 0.0
    dropped_frames: Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)] = 0.0
    outages: list[OutageSpec] = Field(default_factory=list)
    calibration: Calibration = Calibration()
    sway: SwaySpec | None = None
    pose_error: PoseErrorSpec | None = None


def _stands_where_the_rig_does(sensor: SensorSpec, info: ValidationInfo) -> SensorSpec:
    riding = info.data.get("ride") is not None
    if riding and not sensor.rides:
        raise wrong(
            "is placed on the site, but its rig is mounted on a vehicle", "forward_m and left_m"
        )
    if sensor.rides and not riding:
        raise wrong("is placed on a vehicle, but its rig stands", "ride: {track: N} in the rig")
    if riding and sensor.sway is not None:
        raise wrong("sways, but its rig is mounted on a vehicle", "no sway")
    return sensor


class RigSpec(Strict):
    """The sensors that record together, and the frame of their points.

    Attributes:
        rate_hz: frames per second, for all sensors.
        window_s: a frame holds the turns that arrive within this time from its own time on,
            seconds; ``None`` for the time until the next frame.
        frames_by: assigns turns to frames by their ``arrival``, or by their start on the sensor's
            ``clock``.
        frame: frame of the dataset's points: ``sensor`` (that of the first sensor), ``level`` (its
            position and heading, gravity-aligned) or ``site``.
        fused: all sensors' points in one frame; ``False`` for a dataset per sensor.
        label_range_m: actors farther than this from every sensor in plan do not count, metres;
            ``None`` for the sensors' range.
        boxes: ``track``: one box size per track; ``tight``: bounds of the mesh at each time;
            ``kitti``, ``tumtraf``: one size per track, as annotators of that dataset draw it.
        conditions: weather and sun.
        reflectivity: factors on the table of materials, by name.
        sway: sway of the sensors' poles in the wind.
        ride: the actor that carries the rig; ``None`` for a static rig.
        deskew: whether the points of a rig mounted on a vehicle are motion-compensated to the
            frame's time.
        sensors: at least one.
    """

    rate_hz: Rate = 10.0
    window_s: Annotated[float, Field(gt=0.0, le=10.0, allow_inf_nan=False)] | None = None
    frames_by: Literal["arrival", "clock"] = "arrival"
    frame: Literal["sensor", "level", "site"] = "level"
    fused: bool = True
    boxes: BoxKind = "track"
    label_range_m: Annotated[float, Field(ge=1.0, le=1000.0, allow_inf_nan=False)] | None = None
    conditions: Conditions = Conditions()
    reflectivity: Reflectivities = Field(default_factory=dict)
    ride: RideSpec | None = None
    sway: SwaySpec | None = None
    deskew: bool = True
    sensors: Annotated[
        list[Annotated[SensorSpec, AfterValidator(_stands_where_the_rig_does)]],
        Field(min_length=1, max_length=255, description="at least one sensor"),
    ]

    @field_validator("sway")
    @classmethod
    def _only_poles_sway(cls, value: SwaySpec | None, info: ValidationInfo) -> SwaySpec | None:
        if value is not None and info.data.get("ride") is not None:
            raise wrong("is for poles, but the rig rides", "no sway")
        return value

    @field_validator("sensors")
    @classmethod
    def _names_are_unique(cls, value: list[SensorSpec]) -> list[SensorSpec]:
        for name, count in Counter(sensor.name for sensor in value).items():
            if count > 1:
                raise wrong(f"{count} sensors are named {name!r}", "a different name for each")
        return value

    @field_validator("window_s")
    @classmethod
    def _no_turn_is_in_two_frames(cls, value: float | None, info: ValidationInfo) -> float | None:
        rate_hz = info.data.get("rate_hz")
        if value is not None and rate_hz is not None and value * rate_hz > 1.0 + 1e-9:
            raise wrong(f"is {value:g}", f"at most {1 / rate_hz:g}, the time between frames")
        return value

    def standing(self) -> list[tuple[str, float, float]]:
        """Return name, east and north (metres) of the static sensors."""
        return [
            (one.name, one.east_m, one.north_m)
            for one in self.sensors
            if one.east_m is not None and one.north_m is not None
        ]

    def written(self) -> dict[str, Any]:
        """Return the rig as stored in a file, defaults filled in; it loads as the same rig."""
        return self.model_dump(exclude_none=True, by_alias=True)


def rig_spec_from(document: Document, frame: SiteFrame | None = None) -> RigSpec:
    """Return the rig of a document; see `load_rig_spec`."""
    return document.validated(RigSpec, context={"frame": frame})


def load_rig_spec(path: Path, frame: SiteFrame | None = None) -> RigSpec:
    """Read a rig from a YAML file.

    Args:
        path: the file.
        frame: the site's frame, needed for sensors placed by latitude and longitude.

    Raises:
        InputError: the file is missing or wrong; names file, field and line.
    """
    return rig_spec_from(read_document(path, kind="a rig"), frame)
