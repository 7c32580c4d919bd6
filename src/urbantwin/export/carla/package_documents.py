"""The documents of a CARLA package, validated as a client relies on them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, model_validator

from urbantwin.artefact import read_json
from urbantwin.artefact.manifest import Part, PlainName, validated

__all__ = ["read_plan"]

_Metres = Annotated[float, Field(ge=-1e6, le=1e6)]
_Degrees = Annotated[float, Field(ge=-1e4, le=1e4)]
_Speed = Annotated[float, Field(ge=0, le=1000)]


class _Location(Part):
    x: _Metres
    y: _Metres
    z: _Metres


class _Rotation(Part):
    pitch: _Degrees
    yaw: _Degrees
    roll: _Degrees


class _Place(Part):
    location: _Location
    rotation: _Rotation


class _SpawnPoint(_Place):
    allowed: list[str]


class _SpawnPoints(Part):
    spawn_points: list[_SpawnPoint]


class _Blueprints(Part):
    filter: str
    base_type: list[str]
    exclude: Annotated[list[str], Field(alias="except")]


class _Class(Part):
    population: Annotated[int, Field(ge=0, le=100_000)]
    blueprints: _Blueprints
    speed_ms: _Speed | None = None
    tm_speed_difference_percent: Annotated[float, Field(ge=-1000, le=100)] | None = None

    @model_validator(mode="after")
    def _has_a_speed(self) -> _Class:
        if self.speed_ms is None and self.tm_speed_difference_percent is None:
            raise ValueError("a class with speed_ms or tm_speed_difference_percent")
        return self


class _Traffic(Part):
    map: str
    seed: Annotated[int, Field(ge=0, lt=2**31)]
    classes: dict[str, _Class]


class _Sensor(Part):
    name: PlainName
    blueprint: str
    attributes: dict[str, str]
    transform: _Place


class _Rig(Part):
    fixed_delta_seconds: Annotated[float, Field(gt=0, le=60)]
    sensors: list[_Sensor]


class _Carla(Part):
    map: PlainName
    package: PlainName


_FORMS: dict[str, type[Part]] = {
    "traffic": _Traffic,
    "spawn_points": _SpawnPoints,
    "rig": _Rig,
    "carla": _Carla,
}


def read_plan(package: Path) -> dict[str, dict[str, Any]]:
    """Read what a package says of its traffic, the places to begin at, the rig and the map.

    Raises:
        InputError: a document is missing, or a field is missing or wrong; it is named.
    """
    plan = {}
    for name, form in _FORMS.items():
        file = package / f"{name}.json"
        plan[name] = read_json(file, kind=f"CARLA {name}")
        validated(plan[name], form, file=file, expected="what urbantwin export --to carla writes")
    return plan
