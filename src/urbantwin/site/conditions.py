"""Measurement effects, weather and sunlight of a recording, and objects beside streets."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

__all__ = ["Angle", "Clutter", "Conditions", "Effects", "SceneSpec", "Strict"]

Angle = Annotated[float, Field(ge=-360.0, le=360.0, allow_inf_nan=False)]


class Strict(BaseModel):
    """A mapping in a file: unknown fields are rejected, and text is not converted to numbers."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class Effects(Strict):
    """Measurement effects of a sensor; each can be switched off.

    With all off, points are the exact geometry at the frame's time, one per ray that hits a
    surface. In a file, ``effects: false`` turns all off.

    Attributes:
        noise: range noise.
        dropout: weak returns are missed.
        quantisation: ranges and intensities in the sensor's steps.
        rolling_shutter: every ray is cast at its own firing time.
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
        """Return the effects with all switched off."""
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
        sun_elevation_deg: elevation of the sun above the horizon, degrees; ``None`` for 100 klx,
            the light that datasheets' ranges assume.
        sun_azimuth_deg: azimuth of the sun, degrees clockwise from north.
    """

    weather: Literal["clear", "rain", "fog", "snow"] = "clear"
    visibility_m: Annotated[float, Field(gt=0.0, allow_inf_nan=False)] | None = None
    wet_ground: Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)] | None = None
    sun_elevation_deg: Annotated[float, Field(ge=-90.0, le=90.0, allow_inf_nan=False)] | None = None
    sun_azimuth_deg: Angle = 180.0


#: Objects beside streets: mapped ones with typical ones where the map has none, mapped ones only,
#: or none.
Clutter = Literal["typical", "mapped", "none"]


class SceneSpec(Strict):
    """Options of the scene.

    Attributes:
        clutter: objects beside the streets.
    """

    clutter: Clutter = "typical"
