"""Signal programs as people write them in ``site.yaml``, checked without the map."""

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
        green: who has green: arms of the junction that traffic comes from (``north``), travel
            directions (``southbound``), names of streets, lanes (``lane 123_0``) or links
            (``link 4``); each may be followed by ``left``, ``through``, ``right``, ``u-turn``.
        seconds: how long the green lasts; without it, what ``cycle`` leaves is shared out.
        walk: arms whose crossings have green; without it, those that nobody crosses straight on.
        yellow: seconds after it; without it, by the speed limit.
        all_red: seconds after the yellow; without it, by the way to be cleared.
    """

    green: list[str | int]
    seconds: Annotated[Time, Field(gt=0.0)] | None = None
    walk: list[str] | None = None
    yellow: Time | None = None
    all_red: Time | None = None


class StateSpec(_Strict):
    """A phase as SUMO writes it: seconds, and one letter per link.

    Attributes:
        seconds: how long it lasts; where traffic extends it, usually.
        state: the letters.
        at_least: where traffic extends it, how long it lasts at the least, seconds.
        at_most: and at the most.
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
        """How long it lasts at the least and at the most, seconds."""
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
    """The program of one junction's signals.

    Attributes:
        junction: which one: its id or its program's in ``roads.json``, the names of its streets
            (``First Street / Second Street``), or a place nearby.
        cycle: seconds that the program lasts; without it, the sum of the phases.
        offset: seconds after the clock's zero at which the first phase begins.
        phases: the program in words; or
        states: the program letter by letter.
        minimum_green: seconds that no green is shorter than (RiLSA 2015, 2.7: 5 s).
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
        """The latitude and longitude that ``junction`` gives, degrees, if it does."""
        if not isinstance(self.junction, dict):
            return None
        return float(self.junction["latitude"]), float(self.junction["longitude"])

    @property
    def streets(self) -> tuple[str, ...]:
        """The streets that ``junction`` names, if it names any."""
        if not isinstance(self.junction, str):
            return ()
        parts = re.split(r"\s*(?:/|&|\bx\b|×|\band\b)\s*", self.junction)
        return tuple(part for part in parts if part)


@dataclass(frozen=True)
class SignalPlan:
    """A program and where in its file it was written."""

    spec: SignalSpec
    document: Document
    number: int

    def error(
        self, problem: str, location: Sequence[int | str] = (), expected: str | None = None
    ) -> InputError:
        """Return the error to raise for a value of the program."""
        return self.document.error(problem, ("signals", self.number, *location), expected)
