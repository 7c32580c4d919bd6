"""The sensor rig as a person writes it: which sensors, where they stand, where they look."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator, model_validator

from urbantwin.geometry import SiteFrame
from urbantwin.site.document import Document, read_document, wrong

__all__ = ["Conditions", "Effects", "RigSpec", "SensorSpec", "load_rig_spec", "rig_spec_from"]

#: Farther from the anchor than this, single precision loses the millimetre that rays need.
FARTHEST_M = 2000.0

Offset = Annotated[float, Field(ge=-FARTHEST_M, le=FARTHEST_M, allow_inf_nan=False)]
Angle = Annotated[float, Field(ge=-360.0, le=360.0, allow_inf_nan=False)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class Effects(_Strict):
    """What makes a sensor imperfect, each of which can be turned off alone.

    With all off, points are the exact geometry at the frame's time, one per ray that hits anything.

    Attributes:
        noise: range noise.
        dropout: a return is missed where it is weak.
        quantisation: ranges and intensities in the sensor's steps.
        rolling_shutter: every ray sees the world at its own firing time.
        footprint: a beam has a width: mixed ranges and several echoes at edges.
        glass: light passes through glass; without it, glass is an opaque surface.
        retroreflection: plates, signs and beads send light back; strong returns saturate.
        blooming: saturated returns spill over to neighbouring beams.
        sun: sunlight raises the noise floor, where the rig's conditions have a sun.
        weather: rain, fog, snow and wet ground, where the rig's conditions have them.
        crosstalk: a strong return shows up in channels that fire at the same time; off by default.
    """

    noise: bool = True
    dropout: bool = True
    quantisation: bool = True
    rolling_shutter: bool = True
    footprint: bool = True
    glass: bool = True
    retroreflection: bool = True
    blooming: bool = True
    sun: bool = True
    weather: bool = True
    crosstalk: bool = False

    @classmethod
    def none(cls) -> Effects:
        """Return all of them off."""
        return cls(**dict.fromkeys(cls.model_fields, False))

    @model_validator(mode="before")
    @classmethod
    def _all_at_once(cls, value: Any) -> Any:  # noqa: ANN401
        if isinstance(value, bool):
            return {} if value else dict.fromkeys(cls.model_fields, False)
        return value


class Conditions(_Strict):
    """What the air and the light are like while a rig records.

    Attributes:
        weather: what falls or hangs in the air.
        visibility_m: meteorological optical range (contrast falls to 5 %), metres.
        wet_ground: 0 dry to 1 a film of water; ``None``: 1 in rain, else 0.
        sun_elevation_deg: of the sun above the horizon; ``None``: no direct sun.
        sun_azimuth_deg: of the sun, clockwise from north.
    """

    weather: Literal["clear", "rain", "fog", "snow"] = "clear"
    visibility_m: Annotated[float, Field(gt=0.0, allow_inf_nan=False)] | None = None
    wet_ground: Annotated[float, Field(ge=0.0, le=1.0)] | None = None
    sun_elevation_deg: Annotated[float, Field(ge=-90.0, le=90.0)] | None = None
    sun_azimuth_deg: Angle = 180.0


class SensorSpec(_Strict):
    """One sensor: its model and its pose.

    A file gives its place as ``east_m`` and ``north_m`` (site frame) or as ``latitude`` and
    ``longitude`` (degrees, WGS84); here it is always in the site frame.

    Attributes:
        name: unique in the rig; names columns and files.
        model: a name of the sensor catalogue or the path of a sensor's file; checked where the
            rig is placed.
        columns: columns per turn; ``None`` takes the model's default.
        east_m: metres east of the anchor.
        north_m: metres north of the anchor.
        height_m: metres of the sensor's origin above the ground under it.
        yaw_deg: heading of the sensor's x axis, degrees counter-clockwise from east (REP-103).
        pitch_deg: degrees, positive tips the nose down (REP-103).
        roll_deg: degrees about the x axis (REP-103).
        effects: range noise and drop-out, on unless turned off.
    """

    also_written_as: ClassVar[tuple[str, ...]] = ("latitude", "longitude")

    name: Annotated[str, Field(description="a name, unique in the rig")]
    model: Annotated[str, Field(min_length=1, description="a sensor of the catalogue, or its file")]
    columns: Annotated[int, Field(gt=0, le=16384)] | None = None
    east_m: Offset = Field(description="metres east of the anchor")
    north_m: Offset = Field(description="metres north of the anchor")
    height_m: Annotated[float, Field(le=500.0, allow_inf_nan=False)] = Field(
        description="metres above the ground there"
    )
    yaw_deg: Angle = 0.0
    pitch_deg: Annotated[float, Field(ge=-90.0, le=90.0, allow_inf_nan=False)] = 0.0
    roll_deg: Angle = 0.0
    effects: Effects = Effects()

    @model_validator(mode="before")
    @classmethod
    def _place_in_site_frame(cls, value: Any, info: ValidationInfo) -> Any:  # noqa: ANN401
        if not isinstance(value, dict) or not {"latitude", "longitude"} & set(value):
            return value
        if {"east_m", "north_m"} & set(value):
            raise wrong("is placed twice", "east_m and north_m, or latitude and longitude")
        given = dict(value)
        lonlat = [given.pop("longitude", None), given.pop("latitude", None)]
        for name, degrees, most in zip(("longitude", "latitude"), lonlat, (180, 90), strict=True):
            if isinstance(degrees, bool) or not isinstance(degrees, int | float):
                raise wrong(f"{name} is missing or not a number", "degrees, WGS84")
            if not -most <= degrees <= most:
                raise wrong(f"{name} {degrees} is out of range", f"-{most} to {most} degrees")
        frame: SiteFrame | None = (info.context or {}).get("frame")
        if frame is None:
            raise wrong("is placed by latitude and longitude without a site", "east_m and north_m")
        # Far from its meridian the plane's formulas fail; nothing out there is a rig of this site.
        if np.abs(np.subtract(lonlat, [frame.longitude, frame.latitude])).max() > 1.0:
            raise wrong("latitude and longitude are more than 100 km away", "a place on the site")
        east, north = frame.site_from_lonlat([lonlat])[0]
        return {**given, "east_m": round(float(east), 4), "north_m": round(float(north), 4)}

    @field_validator("name")
    @classmethod
    def _name_is_plain(cls, value: str) -> str:
        if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}", value):
            raise wrong(f"{value!r} cannot name files", "letters, digits, '.', '_' and '-'")
        return value

    @field_validator("height_m")
    @classmethod
    def _height_is_above_ground(cls, value: float) -> float:
        if value <= 0:
            raise wrong(f"{value:g} m is under the ground", "a height above the ground there, in m")
        return value


class RigSpec(_Strict):
    """The sensors that record together, and the frame their points are given in.

    Attributes:
        rate_hz: frames per second, of all sensors.
        frame: of the dataset's points: ``sensor`` (that of the first sensor), ``level`` (its place
            and heading, gravity-aligned) or ``site``.
        sensors: at least one.
    """

    rate_hz: Annotated[float, Field(gt=0.0, le=100.0, allow_inf_nan=False)] = 10.0
    frame: Literal["sensor", "level", "site"] = "level"
    sensors: Annotated[list[SensorSpec], Field(min_length=1, description="at least one sensor")]

    @field_validator("sensors")
    @classmethod
    def _names_are_unique(cls, value: list[SensorSpec]) -> list[SensorSpec]:
        for name, count in Counter(sensor.name for sensor in value).items():
            if count > 1:
                raise wrong(f"{count} sensors are named {name!r}", "a different name for each")
        return value


def rig_spec_from(document: Document, frame: SiteFrame | None = None) -> RigSpec:
    """Return the rig that a document holds; see `load_rig_spec`."""
    return document.validated(RigSpec, context={"frame": frame})


def load_rig_spec(path: Path, frame: SiteFrame | None = None) -> RigSpec:
    """Read a rig from a YAML file.

    Args:
        path: the file.
        frame: the site's frame, needed where a sensor is placed by latitude and longitude.

    Raises:
        InputError: the file is missing or wrong; it names the file, the field and the line.
    """
    return rig_spec_from(read_document(path, kind="a rig"), frame)
