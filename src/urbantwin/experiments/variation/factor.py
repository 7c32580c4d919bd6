"""The one factor that is varied: of a sensor, of a signal, of who is there, of the weather."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from urbantwin.errors import InputError
from urbantwin.experiments.study.factors import first_problem
from urbantwin.number_text import finite_number
from urbantwin.site import RigSpec
from urbantwin.site.rig import SensorSpec
from urbantwin.site.yaml_document import nearest
from urbantwin.twin import Twin

__all__ = ["Factor", "read_factor"]

#: Units that a field's name may leave out.
_UNITS = ("", "_m", "_deg", "_s", "_hz", "_ppm")
_KINDS = ("sensor", "signal", "scenario", "insert", "weather", "visibility")
_WEATHERS = ("clear", "rain", "fog", "snow")


@dataclass(frozen=True)
class Factor:
    """What is varied, and its values.

    Attributes:
        text: as it was asked for.
        kind: ``sensor``, ``signal``, ``scenario``, ``insert``, ``weather`` or ``visibility``.
        of: name of the sensor (empty for the rig's only one) or of the signal's program.
        field: of the sensor.
        values: one or more, as text.
    """

    text: str
    kind: str
    of: str
    field: str
    values: tuple[str, ...]

    @property
    def changes_traffic(self) -> bool:
        """Whether it acts on the motion; otherwise on the recording alone."""
        return self.kind in ("signal", "scenario", "insert")

    def name_of(self, value: str) -> str:
        """Return the name of a variant's folder."""
        key = self.text.partition("=")[0]
        plain = Path(value).stem if self.kind == "scenario" else value
        return "=".join(
            "".join(c if c.isalnum() or c in "._-" else "-" for c in part) for part in (key, plain)
        )

    def scenario_of(self, value: str, beside: Path) -> Path:
        """Return the scenario's file.

        Raises:
            InputError: it is not there.
        """
        for folder in (Path(), beside.parent):
            if (folder / value).is_file():
                return folder / value
        raise InputError("not found", file=value, place="--set scenario", expected="a scenario")

    def one_more(self, value: str, twin: Twin, from_s: float, until_s: float) -> dict[str, Any]:
        """Return the event of one more actor, half-way through what is recorded.

        Args:
            value: its class, or the class and a street: ``bicycle@Long Lane``.
            twin: whose lane it takes: of the street, or else the one nearest to the anchor.
            from_s: what is recorded begins, seconds of the motion.
            until_s: and ends.

        Raises:
            InputError: there is no such class or street, or no lane for it.
        """
        from urbantwin.traffic.events import one_passage

        actor, _, street = value.partition("@")
        try:
            return one_passage(actor.strip(), street.strip() or None, twin, from_s, until_s)
        except InputError as error:
            raise self._error(error.problem, error.expected) from None

    def number_of(self, value: str) -> float:
        """Return a value as a number.

        Raises:
            InputError: it is none.
        """
        number = finite_number(value)
        if number is None:
            raise self._error(f"{value!r:.40}", "a number")
        return number

    def rig_with(self, spec: RigSpec, value: str) -> RigSpec:
        """Return a rig in which the sensor's field has a value.

        Raises:
            InputError: there is no such sensor or field, or it cannot have the value.
        """
        names = [one.name for one in spec.sensors]
        if not self.of and len(names) > 1:
            expected = f"sensor.{names[0]}.{self.field} or one of {', '.join(names)}"
            raise self._error("does not say which sensor", expected)
        name = self.of or names[0]
        if name not in names:
            raise self._error(f"there is no sensor {name!r:.40}", nearest(name, names))
        fields = SensorSpec.model_fields
        field = next((self.field + unit for unit in _UNITS if self.field + unit in fields), None)
        if field is None or field == "name":
            expected = nearest(self.field, [one for one in fields if one != "name"])
            raise self._error(f"a sensor has no {self.field!r:.40}", expected)
        written = spec.written()
        one = next(row for row in written["sensors"] if row["name"] == name)
        number = finite_number(value)
        usual = one.get(field)
        if field == "columns" and number is not None:
            number = int(number)
        one[field] = value if number is None or isinstance(usual, str) else number
        try:
            return RigSpec.model_validate(written, strict=True)
        except ValueError as error:
            raise self._error(
                f"{value!r:.40}: {first_problem(error)}",
                f"a value that a sensor's {field} can have",
            ) from None

    def _error(self, problem: str, expected: str | None) -> InputError:
        return InputError(problem, place=f"--set {self.text}", expected=expected)


def read_factor(text: str) -> Factor:
    """Read ``sensor.height=4,5,6.5``, ``signal.ID.offset=10``, ``insert=bicycle`` and the like.

    Raises:
        InputError: it says no factor.
    """
    key, found, values = text.partition("=")
    several = tuple(one.strip() for one in values.split(",") if one.strip())
    kind, _, rest = key.strip().partition(".")
    expected = (
        "sensor.height=6.5, sensor.NAME.FIELD=VALUE, signal.PROGRAM.offset=SECONDS, scenario=FILE, "
        "insert=bicycle, insert=CLASS@STREET, weather=rain or visibility=300; several values with "
        "commas"
    )
    if not found or not several or kind not in _KINDS or len(set(several)) < len(several):
        raise InputError(f"{text!r:.80}", place="--set", expected=expected)
    of, _, field = rest.rpartition(".")
    if kind == "sensor":
        wrong = not field
    elif kind == "signal":
        wrong = not of or field != "offset"
    else:
        wrong = bool(rest) or (kind == "weather" and not set(several) <= set(_WEATHERS))
    factor = Factor(text.strip(), kind, of, field, several)
    if wrong:
        raise InputError(f"{text!r:.80}", place="--set", expected=expected)
    if kind in ("signal", "visibility"):
        for value in several:
            factor.number_of(value)
    return factor
