"""Sensor effects, the weather and sunlight of a recording, and what stands beside streets."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

__all__ = ["Angle", "Clutter", "Conditions", "Effects", "SceneSpec", "Strict"]

Angle = Annotated[float, Field(ge=-360.0, le=360.0, allow_inf_nan=False)]


class Strict(BaseModel):
    """A mapping in a file: unknown fields are refused, and text is not taken for a number."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class Effects(Strict):
    """Imperfections of a sensor, each of which can be switched off on its own.

    With all off, points are the exact geometry at the frame's time, one per ray that hits anything.
    In a file, ``effects: false`` turns all off.

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


class Conditions(Strict):
    """Weather and sunlight while a rig records.

    Attributes:
        weather: clear, rain, fog or snow.
        visibility_m: meteorological optical range (contrast falls to 5 %), metres.
        wet_ground: 0 dry to 1 a film of water; ``None``: 1 in rain, else 0.
        sun_elevation_deg: of the sun above the horizon; ``None``: the light that datasheets'
            ranges are for, 100 klx.
        sun_azimuth_deg: of the sun, clockwise from north.
    """

    weather: Literal["clear", "rain", "fog", "snow"] = "clear"
    visibility_m: Annotated[float, Field(gt=0.0, allow_inf_nan=False)] | None = None
    wet_ground: Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)] | None = None
    sun_elevation_deg: Annotated[float, Field(ge=-90.0, le=90.0, allow_inf_nan=False)] | None = None
    sun_azimuth_deg: Angle = 180.0


#: What stands beside streets: what is mapped, with what is typical where the map is silent, or
#: neither.
Clutter = Literal["typical", "mapped", "none"]


class SceneSpec(Strict):
    """Options of the scene.

    Attributes:
        clutter: what stands beside the streets.
    """

    clutter: Clutter = "typical"
