"""The factor of a variation: a sensor's field, a signal, inserted actors, or weather."""

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
    """A varied factor with its values.

    Attributes:
        text: text of the request.
        kind: ``sensor``, ``signal``, ``scenario``, ``insert``, ``weather`` or ``visibility``.
        of: name of the sensor (empty for the rig's only one) or of the signal's program.
        field: field of the sensor.
        values: one or more values, as text.
    """

    text: str
    kind: str
    of: str
    field: str
    values: tuple[str, ...]

    @property
    def changes_traffic(self) -> bool:
        """Whether it changes the motion, otherwise only the recording."""
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
            InputError: the file does not exist.
        """
        for folder in (Path(), beside.parent):
            if (folder / value).is_file():
                return folder / value
        raise InputError("not found", file=value, place="--set scenario", expected="a scenario")

    def one_more(self, value: str, twin: Twin, from_s: float, until_s: float) -> dict[str, Any]:
        """Return the event that inserts an actor in the middle of the recording.

        Args:
            value: its class, or class and street: ``bicycle@Long Lane``.
            twin: twin with its lane: that of the street, or else the nearest to the anchor.
            from_s: start of the recording, seconds of the motion.
            until_s: end of the recording, seconds of the motion.

        Raises:
            InputError: the class or street is unknown, or has no suitable lane.
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
            InputError: the value is not a number.
        """
        number = finite_number(value)
        if number is None:
            raise self._error(f"{value!r:.40}", "a number")
        return number

    def rig_with(self, spec: RigSpec, value: str) -> RigSpec:
        """Return a rig with a value set in a sensor's field.

        Raises:
            InputError: the sensor or field is unknown, or the value is not allowed.
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
    """Return the factor of a text such as ``sensor.height=4,5,6.5`` or ``insert=bicycle``.

    Raises:
        InputError: the text is malformed.
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
