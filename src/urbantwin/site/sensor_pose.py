"""Position and attitude of a sensor, in all forms allowed in files."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field, ValidationInfo, field_validator, model_validator

from urbantwin.geometry import SiteFrame
from urbantwin.site.conditions import Angle, Strict
from urbantwin.site.yaml_document import wrong

__all__ = ["FARTHEST_M", "SensorPlace"]

#: Largest distance from the anchor, metres; beyond, single precision loses the millimetre that rays
#: need.
FARTHEST_M = 2000.0

Offset = Annotated[float, Field(ge=-FARTHEST_M, le=FARTHEST_M, allow_inf_nan=False)]
#: Position on a carrier, metres; road trains are the longest vehicles.
OnCarrier = Annotated[float, Field(ge=-60.0, le=60.0, allow_inf_nan=False)]
Tip = Annotated[float, Field(ge=-90.0, le=90.0, allow_inf_nan=False)]

_RIDES = ("forward_m", "left_m")
_HEIGHTS = ("height_m", "up_m", "altitude_m", "above_roof_m")


class SensorPlace(Strict):
    """Position and attitude of a sensor.

    On the site, a file gives ``east_m`` and ``north_m``, or ``latitude`` and ``longitude``; and one
    of ``height_m``, ``up_m`` and ``altitude_m``. On a rig mounted on a vehicle, it gives
    ``forward_m`` and ``left_m``, and one of ``height_m`` and ``above_roof_m``. The heading is
    ``yaw_deg`` or ``heading_deg``, the tilt ``pitch_deg`` or ``tilt_deg``. The attributes are
    always in metres of the site or of the carrier, and as yaw and pitch.

    Attributes:
        east_m: metres east of the anchor.
        north_m: metres north of the anchor.
        forward_m: metres ahead of the centre of the vehicle that carries the sensor.
        left_m: metres to the left of that centre.
        height_m: metres of the sensor's origin above the ground under it.
        up_m: metres above the anchor's ground: z of the site frame.
        altitude_m: metres above the zero of the DEM's heights (the sea).
        above_roof_m: metres above the highest point of the vehicle.
        yaw_deg: heading of the sensor's x axis, degrees counter-clockwise from east, or from the
            carrier's forward (REP-103).
        pitch_deg: degrees, positive tips the nose down (REP-103).
        roll_deg: degrees about the x axis (REP-103).
    """

    also_written_as: ClassVar[tuple[str, ...]] = (
        "latitude",
        "longitude",
        "heading_deg",
        "tilt_deg",
    )

    east_m: Offset | None = None
    north_m: Offset | None = None
    forward_m: OnCarrier | None = None
    left_m: OnCarrier | None = None
    height_m: Annotated[float, Field(le=500.0, allow_inf_nan=False)] | None = None
    up_m: Offset | None = None
    altitude_m: Annotated[float, Field(ge=-12000, le=12000, allow_inf_nan=False)] | None = None
    above_roof_m: Annotated[float, Field(ge=0.0, le=10.0, allow_inf_nan=False)] | None = None
    yaw_deg: Angle = 0.0
    pitch_deg: Tip = 0.0
    roll_deg: Angle = 0.0

    @property
    def rides(self) -> bool:
        """Whether the position is on a vehicle."""
        return self.forward_m is not None

    @model_validator(mode="before")
    @classmethod
    def _in_our_own_terms(cls, value: Any, info: ValidationInfo) -> Any:  # noqa: ANN401
        if not isinstance(value, dict):
            return value
        given = _attitude(
            {
                key: item
                for key, item in value.items()
                if item is not None or (key in cls.also_written_as)
            }
        )
        if {"latitude", "longitude"} & set(given):
            given = _place(given, (info.context or {}).get("frame"))
        return given

    @model_validator(mode="after")
    def _is_whole(self) -> SensorPlace:
        given = {name for name in type(self).model_fields if getattr(self, name) is not None}
        if given & set(_RIDES):
            if given & {"east_m", "north_m"}:
                raise wrong("is placed twice", "a place on the site, or one on a vehicle")
            if not {"forward_m", "left_m"} <= given:
                raise wrong("has half a place on its vehicle", "forward_m and left_m")
            heights: tuple[str, ...] = ("height_m", "above_roof_m")
        else:
            if not {"east_m", "north_m"} <= given:
                raise wrong("has no place", "east_m and north_m, or latitude and longitude")
            heights = ("height_m", "up_m", "altitude_m")
        said = [name for name in _HEIGHTS if name in given]
        if len(said) != 1 or said[0] not in heights:
            problem = f"has {len(said)} heights" if said else "has no height"
            if len(said) == 1:
                problem = f"has {said[0]}, which is for the other kind of place"
            raise wrong(problem, "one of " + ", ".join(heights))
        return self

    @field_validator("height_m")
    @classmethod
    def _height_is_above_ground(cls, value: float | None) -> float | None:
        if value is not None and value <= 0:
            raise wrong(f"{value:g} m is under the ground", "a height above the ground there, in m")
        return value


def _attitude(given: dict[str, Any]) -> dict[str, Any]:
    """Return the fields with heading and tilt converted to yaw and pitch."""
    for ours, theirs, most in (("yaw_deg", "heading_deg", 360.0), ("pitch_deg", "tilt_deg", 90.0)):
        if theirs not in given:
            continue
        if ours in given:
            raise wrong(f"has both {ours} and {theirs}", "one of them")
        degrees = _number(given, theirs, most)
        if theirs == "heading_deg":
            if set(_RIDES) & set(given):
                raise wrong("heading_deg on a vehicle, which turns", "yaw_deg from its forward")
            degrees = (90.0 - degrees + 180.0) % 360.0 - 180.0
        given = {key: item for key, item in given.items() if key != theirs} | {ours: degrees}
    return given


def _place(given: dict[str, Any], frame: SiteFrame | None) -> dict[str, Any]:
    """Return the fields with latitude and longitude converted to the site frame."""
    if {"east_m", "north_m", *_RIDES} & set(given):
        raise wrong("is placed twice", "east_m and north_m, or latitude and longitude")
    lonlat = [_number(given, "longitude", 180.0), _number(given, "latitude", 90.0)]
    if frame is None:
        raise wrong("is placed by latitude and longitude without a site", "east_m and north_m")
    # Far from its meridian the projection's formulas fail; no sensor of this site is there.
    if np.abs(np.subtract(lonlat, [frame.longitude, frame.latitude])).max() > 1.0:
        raise wrong("latitude and longitude are more than 100 km away", "a place on the site")
    east, north = frame.site_from_lonlat([lonlat])[0]
    rest = {key: item for key, item in given.items() if key not in ("latitude", "longitude")}
    return {**rest, "east_m": round(float(east), 4), "north_m": round(float(north), 4)}


def _number(given: dict[str, Any], name: str, most: float) -> float:
    degrees = given.get(name)
    if isinstance(degrees, bool) or not isinstance(degrees, int | float):
        raise wrong(f"{name} is missing or not a number", "degrees")
    if not -most <= degrees <= most:
        raise wrong(f"{name} {degrees} is out of range", f"-{most:g} to {most:g} degrees")
    return float(degrees)
