"""Format of a preset's file: a place, its traffic, and its rig as in ``site.yaml``.

There is one file per place in this folder; comments in it give the sources of values. The files
contain no data of a recording, only published facts about the place and the sensors.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, field_validator, model_validator

from urbantwin.errors import InputError
from urbantwin.site.conditions import Strict
from urbantwin.site.yaml_document import read_document, wrong
from urbantwin.taxonomy import ACTOR_CLASSES

__all__ = ["Preset", "PresetPlace", "PresetTraffic", "preset", "preset_names"]


class PresetPlace(Strict):
    """Position of a place.

    Attributes:
        latitude: latitude of the anchor, degrees, WGS84.
        longitude: longitude of the anchor, degrees, WGS84.
        within_m: uncertainty of the position, metres.
        streets: possible beginnings of the name of each street at the junction; the anchor is where
            they meet in an extract, within ``within_m``.
    """

    latitude: Annotated[float, Field(ge=-90, le=90, allow_inf_nan=False)]
    longitude: Annotated[float, Field(ge=-180, le=180, allow_inf_nan=False)]
    within_m: Annotated[float, Field(gt=0, le=2000)]
    streets: list[Annotated[list[str], Field(min_length=1)]] = Field(default_factory=list)


class PresetTraffic(Strict):
    """The traffic, by one of two measures.

    Attributes:
        per_hour: vehicles and pedestrians per hour, by class.
        boxes_per_frame: mean number of boxes of a class per frame, if there is no count.
        source: source of the numbers.
    """

    per_hour: dict[str, Annotated[int, Field(ge=0)]] | None = None
    boxes_per_frame: dict[str, Annotated[float, Field(ge=0)]] | None = None
    source: str

    @field_validator("per_hour", "boxes_per_frame")
    @classmethod
    def _classes_are_known(cls, value: dict[str, float] | None) -> dict[str, float] | None:
        unknown = set(value or {}) - set(ACTOR_CLASSES)
        if unknown:
            raise wrong(f"{min(unknown)} is no class", "one of " + ", ".join(ACTOR_CLASSES))
        return value


class PresetSensor(Strict):
    """Fields of a sensor used by `Preset`; further fields are those of ``site.yaml``.

    A sensor has a position and angles, or a pole is proposed for it (``corner``), or it is mounted
    on the pole of another sensor (``beside``, ``offset_m``: metres east, north and up from that
    one).

    Attributes:
        name: name, unique in the preset.
        model: model of the catalogue.
        columns: firings per turn.
        corner: quadrant around the anchor, or ``opposite`` to the previous pole.
        beside: name of a previous sensor.
    """

    model_config = ConfigDict(extra="allow")

    name: str
    model: str
    columns: int | None = None
    corner: (
        Literal["north-east", "north-west", "south-west", "south-east", "any", "opposite"] | None
    ) = None
    beside: str | None = None

    @property
    def is_placed(self) -> bool:
        """Whether its position is published, not proposed."""
        return self.corner is None and self.beside is None


class PresetRig(Strict):
    """Fields of the rig used by `Preset`."""

    rate_hz: Annotated[float, Field(gt=0, le=100)]
    frame: str
    boxes: str
    sensors: Annotated[list[PresetSensor], Field(min_length=1)]


class Preset(Strict):
    """A place at which a dataset was recorded.

    Attributes:
        name: its name on the command line.
        title: streets and town.
        country: code of ISO 3166.
        recording: the dataset, and its authors.
        licence: licence of the recording, of which no data are included.
        homepage: web page of the recording.
        place: its position; ``None`` if not published.
        radius_m: radius of the region, metres.
        traffic: measured traffic.
        unknown: unpublished facts, in sentences.
        rig: the sensors.
        sources: lines of comment about the sources of the place.
        rig_text: the mapping ``rig`` with its comments, as in the file.
    """

    name: str
    title: str
    country: Annotated[str, Field(pattern="^[A-Z]{2}$")]
    recording: str
    licence: str
    homepage: str
    place: PresetPlace | None = None
    radius_m: Annotated[float, Field(ge=20, le=500)]
    traffic: PresetTraffic | None = None
    unknown: Annotated[list[str], Field(min_length=1)]
    rig: PresetRig
    sources: tuple[str, ...] = Field(default=(), exclude=True)
    rig_text: str = Field(default="", exclude=True)

    @model_validator(mode="after")
    def _stands_beside_what_it_has(self) -> Preset:
        names: list[str] = []
        for sensor in self.rig.sensors:
            if sensor.beside is not None and sensor.beside not in names:
                raise wrong(f"{sensor.name} is beside {sensor.beside!r}", "a sensor before it")
            names.append(sensor.name)
        return self


def preset_names() -> tuple[str, ...]:
    """Return the names of the presets, sorted."""
    return tuple(sorted(_files()))


@cache
def _files() -> Mapping[str, Path]:
    folder = Path(str(files("urbantwin.site.presets")))
    return {path.stem: path for path in folder.glob("*.yaml")}


@cache
def preset(name: str) -> Preset:
    """Return the preset with a name; case, blanks and underscores are ignored.

    Raises:
        InputError: the preset is unknown; names the most similar one.
    """
    plain = name.strip().lower().replace("_", "-").replace(" ", "-")
    if plain not in _files():
        nearest = difflib.get_close_matches(plain, preset_names(), n=1, cutoff=0.4)
        expected = f"{nearest[0]}; " if nearest else ""
        raise InputError(
            f"{name!r:.60} is no preset",
            place="--preset",
            expected=f"{expected}`urbantwin site presets` lists them",
        )
    path = _files()[plain]
    text = path.read_text(encoding="utf-8")
    comments = [line[2:] for line in text.partition("\nname:")[0].splitlines()]
    read: dict[str, Any] = {"sources": tuple(comments), "rig_text": text.partition("\nrig:\n")[2]}
    return read_document(path, kind="a preset").validated(Preset).model_copy(update=read)
