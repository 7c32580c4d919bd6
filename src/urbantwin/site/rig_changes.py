"""Changes to a rig for one recording: weather, effects, carrier."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from urbantwin.errors import InputError
from urbantwin.number_text import whole_number
from urbantwin.site.conditions import Conditions, Effects
from urbantwin.site.rig import RideSpec, RigSpec
from urbantwin.site.yaml_document import Document, nearest

__all__ = ["RigChanges"]

_ASKED = Path("command line")


@dataclass(frozen=True)
class RigChanges:
    """Changes to a rig; ``None`` keeps the rig's value.

    Attributes:
        effects: effects to turn on, ``no-NAME`` for off, ``all`` or ``none``, separated by commas,
            applied from left to right to every sensor.
        weather: see `Conditions`.
        visibility_m: see `Conditions`.
        wet_ground: see `Conditions`.
        sun_elevation_deg: see `Conditions`.
        sun_azimuth_deg: see `Conditions`.
        ride: track or class of the actor that carries a vehicle-mounted rig.
        fused: one dataset of all sensors, or one per sensor.
    """

    effects: str | None = None
    weather: str | None = None
    visibility_m: float | None = None
    wet_ground: float | None = None
    sun_elevation_deg: float | None = None
    sun_azimuth_deg: float | None = None
    ride: str | None = None
    fused: bool | None = None

    def applied_to(self, spec: RigSpec) -> RigSpec:
        """Return the rig with the changes applied.

        Raises:
            InputError: an effect, weather or class is unknown, or the rig is not mounted on a
                vehicle.
        """
        changed: dict[str, Any] = {"conditions": self._conditions(spec.conditions)}
        if self.effects is not None:
            changed["sensors"] = [
                one.model_copy(update={"effects": _effects(self.effects, one.effects)})
                for one in spec.sensors
            ]
        if self.ride is not None:
            if spec.ride is None:
                raise InputError("the rig is static", place="--ride", expected="a rig with ride:")
            text = self.ride.strip()
            track = whole_number(text)
            ride = {"class": text} if track is None else {"track": track}
            changed["ride"] = Document(_ASKED, ride).validated(RideSpec)
        if self.fused is not None:
            changed["fused"] = self.fused
        return spec.model_copy(update=changed)

    def _conditions(self, given: Conditions) -> Conditions:
        names = Conditions.model_fields
        asked = {name: getattr(self, name) for name in names if getattr(self, name) is not None}
        return Document(_ASKED, given.model_dump() | asked).validated(Conditions)


def _effects(text: str, given: Effects) -> Effects:
    """Return effects after changes such as ``none,noise`` or ``no-sun``."""
    values = given.model_dump()
    for item in text.split(","):
        word = item.strip()
        name = word.removeprefix("no-").replace("-", "_")
        if word in ("all", "none"):
            values = dict.fromkeys(values, word == "all")
        elif name in values:
            values[name] = not word.startswith("no-")
        else:
            raise InputError(
                f"there is no effect {word!r:.40}",
                place="--effects",
                expected=f"all, none, no-NAME or {nearest(name, list(values))}",
            )
    return Effects(**values)
