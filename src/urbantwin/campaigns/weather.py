"""Settings of weather, light and faults by name, and a rig with one of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from urbantwin.grid import Axis, Level
from urbantwin.site import RigSpec
from urbantwin.site.conditions import Conditions, Strict
from urbantwin.site.rig_changes import RigChanges
from urbantwin.site.yaml_document import Document, nearest
from urbantwin.studies.robustness import FACTORS, FactorAsked, rig_at

__all__ = ["Setting", "settings_of"]

#: What a study varies that is no matter of a rig alone, or of sensors by their names.
_NOT_HERE = ("traffic_density", "outage_unit")
_FAULTS = tuple(name for name in FACTORS if name not in _NOT_HERE)
_CONDITIONS = tuple(Conditions.model_fields)


class _Effects(Strict):
    effects: str | None = None


@dataclass(frozen=True)
class Setting:
    """What a level of the weather changes of a rig.

    Attributes:
        name: of the level.
        changes: weather, light and effects.
        faults: factors of a study of robustness, and the level of each.
    """

    name: str
    changes: RigChanges
    faults: tuple[tuple[str, Level], ...] = ()

    def applied_to(self, spec: RigSpec) -> RigSpec:
        """Return a rig with it.

        Raises:
            InputError: there is no such effect.
            ValueError: the rig cannot have it.
        """
        changed = self.changes.applied_to(spec)
        if not self.faults:
            return changed
        asked = [FactorAsked(Axis(name, (level,))) for name, level in self.faults]
        return rig_at(changed, asked, dict(self.faults))

    def told(self) -> dict[str, Any]:
        """Return it as it is kept: what it changes, by name."""
        given = {key: value for key, value in vars(self.changes).items() if value is not None}
        return {**given, **dict(self.faults)}


def settings_of(document: Document, given: list[str] | Mapping[str, Any]) -> tuple[Setting, ...]:
    """Return the settings of a file's ``weather:``.

    Args:
        document: the file.
        given: names of weathers, or settings by name.

    Raises:
        InputError: a setting is not known, or cannot be.
    """
    if isinstance(given, Mapping):
        return tuple(_setting(document, name, values) for name, values in given.items())
    kinds = ("clear", "rain", "fog", "snow")
    for number, name in enumerate(given):
        if name not in kinds:
            raise document.error(
                f"there is no weather {name!r:.40}", ["weather", number], nearest(name, kinds)
            )
    return tuple(Setting(name, RigChanges(weather=name)) for name in given)


def _setting(document: Document, name: str, values: object) -> Setting:
    if values is None:
        values = {}
    if not isinstance(values, Mapping):
        raise document.error(
            "is no mapping of fields", ["weather", name], "weather, visibility_m, ... and values"
        )
    row = document.part("weather", name) if values else document
    known = (*_CONDITIONS, "effects", *_FAULTS)
    strange = next((key for key in values if key not in known), None)
    if strange is not None:
        raise row.error("is not a field that is known here", [strange], nearest(strange, known))
    faults = [(key, values[key]) for key in values if key in _FAULTS]
    for key, level in faults:
        factor = FACTORS[key]
        told = isinstance(level, int | float | str) and not isinstance(level, bool)
        if not told or not factor.allows(level, ()):
            raise row.error(f"is {level!r:.40}", [key], factor.expected)

    def part(*names: str) -> Document:
        chosen = {key: values[key] for key in values if key in names}
        return Document(row.file, chosen, row.root, row.prefix)

    conditions = part(*_CONDITIONS).validated(Conditions)
    effects = part("effects").validated(_Effects).effects
    asked = {key: getattr(conditions, key) for key in values if key in _CONDITIONS}
    return Setting(name, RigChanges(effects=effects, **asked), tuple(faults))
