"""Outages of a sensor: for a time a sector, a channel or the whole of it reports nothing."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field, field_validator, model_validator

from urbantwin.site.conditions import Angle, Strict
from urbantwin.site.yaml_document import wrong

__all__ = ["OutageSpec"]

_MOST_CHANNELS = 65536


class OutageSpec(Strict):
    """Beams that report nothing for a time. A field that is left out does not restrict them.

    Attributes:
        sector_deg: two azimuths in the sensor's frame, degrees counter-clockwise from x: all beams
            from the first counter-clockwise to the second; ``[150, -150]`` is 60 degrees behind.
        channels: numbers as in ``ring``, from 0; a file may also give spans: ``["0-15", 20]``.
        start_s: time of the motion from which on.
        stop_s: up to which time, not included; ``None``: for good.
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
