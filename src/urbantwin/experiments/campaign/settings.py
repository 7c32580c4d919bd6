"""Settings of weather, light and faults by name, and rigs with such a setting."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import AfterValidator, create_model

from urbantwin.experiments.grid import Axis, Level
from urbantwin.experiments.study.factors import FACTORS, FactorAsked, rig_at
from urbantwin.site import RigSpec
from urbantwin.site.conditions import Conditions
from urbantwin.site.rig_changes import RigChanges
from urbantwin.site.yaml_document import Document, nearest, wrong

__all__ = ["Setting", "settings_of"]

#: Factors of a study, except those not of the rig alone and those that name sensors.
_FAULTS = tuple(name for name in FACTORS if name not in ("traffic_density", "outage_unit"))
_WEATHERS = ("clear", "rain", "fog", "snow")


def _level_of(name: str) -> Any:  # noqa: ANN401 - a type
    def allowed(level: Any) -> Any:  # noqa: ANN401
        of_a_kind = isinstance(level, int | float | str) and not isinstance(level, bool)
        if not of_a_kind or not FACTORS[name].allows(level, ()):
            raise wrong(f"is {level!r:.40}", FACTORS[name].expected)
        return level

    return Annotated[Any, AfterValidator(allowed)]


#: Weather and light, ``effects``, and faults by name.
_Fields: type[Conditions] = create_model(
    "_Fields",
    __base__=Conditions,
    effects=(str | None, None),
    **{name: (_level_of(name), None) for name in _FAULTS},
)  # type: ignore[call-overload]


@dataclass(frozen=True)
class Setting:
    """Changes that a weather level makes to a rig.

    Attributes:
        name: name of the level.
        changes: weather, light and effects.
        faults: factors of a robustness study, and the level of each.
    """

    name: str
    changes: RigChanges
    faults: tuple[tuple[str, Level], ...] = ()

    def applied_to(self, spec: RigSpec) -> RigSpec:
        """Return a rig with the setting.

        Raises:
            InputError: there is no such effect.
            ValueError: the setting is not possible with this rig.
        """
        changed = self.changes.applied_to(spec)
        factors = [FactorAsked(Axis(name, (level,))) for name, level in self.faults]
        return rig_at(changed, factors, dict(self.faults)) if factors else changed

    def changed(self) -> dict[str, Any]:
        """Return the changes by name, for the index."""
        given = {key: value for key, value in vars(self.changes).items() if value is not None}
        return {**given, **dict(self.faults)}


def settings_of(document: Document, given: list[str] | Mapping[str, Any]) -> tuple[Setting, ...]:
    """Return the settings of a file's ``weather:``.

    Args:
        document: the file.
        given: names of weathers, or settings by name.

    Raises:
        InputError: a setting is unknown or not possible.
    """
    if isinstance(given, Mapping):
        return tuple(
            _setting(document, name, {} if values is None else values)
            for name, values in given.items()
        )
    for number, name in enumerate(given):
        if name not in _WEATHERS:
            raise document.error(
                f"there is no weather {name!r:.40}", ["weather", number], nearest(name, _WEATHERS)
            )
    return tuple(Setting(name, RigChanges(weather=name)) for name in given)


def _setting(document: Document, name: str, values: object) -> Setting:
    if not isinstance(values, Mapping):
        raise document.error(
            "is no mapping of fields", ["weather", name], "weather, visibility_m, ... and values"
        )
    fields = document.part("weather", name).validated(_Fields) if values else _Fields()
    changes = {key: getattr(fields, key) for key in values if key not in _FAULTS}
    faults = tuple((key, getattr(fields, key)) for key in values if key in _FAULTS)
    return Setting(name, RigChanges(**changes), faults)
