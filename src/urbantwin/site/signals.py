"""Signal programs of ``site.yaml``, checked without the map."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from urbantwin.errors import InputError
from urbantwin.site.yaml_document import Document, wrong

__all__ = ["PhaseSpec", "SignalPlan", "SignalSpec", "StateSpec"]

#: What a signal can show (SUMO, "Traffic Lights", signal state definitions).
STATES = "GgyYruoOs"
LIMITS = {"latitude": 90, "longitude": 180}
Time = Annotated[float, Field(ge=0.0, le=600.0, allow_inf_nan=False)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class PhaseSpec(_Strict):
    """A phase in words.

    Attributes:
        green: movements with green: arms of the junction that traffic comes from (``north``),
            travel directions (``southbound``), names of streets, lanes (``lane 123_0``) or links
            (``link 4``); each may be followed by ``left``, ``through``, ``right``, ``u-turn``.
        seconds: duration of the green, seconds; if not given, the rest of ``cycle`` is distributed.
        walk: arms whose crossings have green; if not given, those not crossed by through traffic.
        yellow: duration of the yellow, seconds; if not given, from the speed limit.
        all_red: all-red time after the yellow, seconds; if not given, from the clearance distance.
    """

    green: list[str | int]
    seconds: Annotated[Time, Field(gt=0.0)] | None = None
    walk: list[str] | None = None
    yellow: Time | None = None
    all_red: Time | None = None


class StateSpec(_Strict):
    """A phase in SUMO's notation: duration, and one letter per link.

    Attributes:
        seconds: duration, seconds; the typical one if traffic-actuated.
        state: the letters.
        at_least: minimum duration if traffic-actuated, seconds.
        at_most: maximum duration if traffic-actuated, seconds.
    """

    seconds: Annotated[Time, Field(gt=0.0)]
    state: Annotated[str, Field(min_length=1)]
    at_least: Annotated[Time, Field(gt=0.0)] | None = None
    at_most: Time | None = None

    @model_validator(mode="after")
    def _lasts_as_long_as_it_may(self) -> StateSpec:
        if (self.at_least is None) != (self.at_most is None):
            raise wrong("is extended within one limit", "both at_least and at_most, or neither")
        least, most = self.lasts
        if not least <= self.seconds <= most:
            raise wrong(
                f"lasts {self.seconds:g} s, and {least:g} to {most:g} s",
                "seconds between at_least and at_most",
            )
        return self

    @property
    def lasts(self) -> tuple[float, float]:
        """Minimum and maximum duration, seconds."""
        if self.at_least is None or self.at_most is None:
            return self.seconds, self.seconds
        return self.at_least, self.at_most

    @field_validator("state")
    @classmethod
    def _letters_are_known(cls, value: str) -> str:
        if other := sorted(set(value) - set(STATES)):
            raise wrong(f"has the letter {other[0]!r}", f"letters of {STATES}, one per link")
        return value


class SignalSpec(_Strict):
    """The signal program of a junction.

    Attributes:
        junction: junction: its id or its program's in ``roads.json``, the names of its streets
            (``First Street / Second Street``), or a place nearby.
        cycle: cycle time, seconds; if not given, the sum of the phases.
        offset: start of the first phase after the clock's zero, seconds.
        phases: the program in words; or
        states: the program letter by letter.
        minimum_green: shortest green, seconds (RiLSA 2015, 2.7: 5 s).
    """

    junction: str | int | dict[str, Any] = Field(
        description="the id of a signalised junction, the names of its streets, or a place"
    )
    cycle: Annotated[Time, Field(ge=10.0)] | None = None
    offset: Annotated[float, Field(ge=-600.0, le=600.0, allow_inf_nan=False)] | None = None
    phases: Annotated[list[PhaseSpec], Field(min_length=1)] | None = None
    states: Annotated[list[StateSpec], Field(min_length=1)] | None = None
    minimum_green: Time = 5.0

    @field_validator("junction", mode="before")
    @classmethod
    def _junction_is_one(cls, value: Any) -> Any:  # noqa: ANN401
        if isinstance(value, dict):
            if set(value) != set(LIMITS):
                raise wrong("is not a place", "latitude and longitude, degrees")
            for name, limit in LIMITS.items():
                degrees = value[name]
                if not isinstance(degrees, int | float) or not abs(degrees) <= limit:
                    raise wrong(f"has the {name} {degrees!r}", f"degrees, -{limit} to {limit}")
        elif isinstance(value, bool) or not isinstance(value, str | int):
            raise wrong("is neither", "an id, names of streets, or a latitude and longitude")
        return value

    @model_validator(mode="after")
    def _says_something_once(self) -> SignalSpec:
        if self.phases is not None and self.states is not None:
            raise wrong("has two programs", "phases or states, and not both")
        if self.phases is None and self.states is None and self.offset is None:
            raise wrong("changes nothing", "phases, states or an offset")
        return self

    @property
    def place(self) -> tuple[float, float] | None:
        """Latitude and longitude given by ``junction``, degrees, if any."""
        if not isinstance(self.junction, dict):
            return None
        return float(self.junction["latitude"]), float(self.junction["longitude"])

    @property
    def streets(self) -> tuple[str, ...]:
        """Streets named by ``junction``, if any."""
        if not isinstance(self.junction, str):
            return ()
        parts = re.split(r"\s*(?:/|&|\bx\b|×|\band\b)\s*", self.junction)
        return tuple(part for part in parts if part)


@dataclass(frozen=True)
class SignalPlan:
    """A program, with its place in its file."""

    spec: SignalSpec
    document: Document
    number: int

    def error(
        self, problem: str, location: Sequence[int | str] = (), expected: str | None = None
    ) -> InputError:
        """Return the error for a value of the program."""
        return self.document.error(problem, ("signals", self.number, *location), expected)
