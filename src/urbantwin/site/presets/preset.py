"""The form of a preset's file: a place, its sensors, its traffic, each value with its source.

The files stand in this folder, one for each place. They hold no data of a recording, only what its
makers published of the place and the sensors, and what they did not publish.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from urbantwin.errors import InputError
from urbantwin.site.conditions import Strict
from urbantwin.site.yaml_document import read_document, wrong
from urbantwin.taxonomy import ACTOR_CLASSES

__all__ = [
    "Corner",
    "Preset",
    "PresetFrame",
    "PresetPlace",
    "PresetSensor",
    "PresetTraffic",
    "preset",
    "preset_names",
]

Number = Annotated[float, Field(allow_inf_nan=False)]
Row = Annotated[list[Number], Field(min_length=4, max_length=4)]
Corner = Literal["north-east", "north-west", "south-west", "south-east", "any", "opposite"]


class _Sourced(Strict):
    """A part of a preset, each field of which has a source.

    Attributes:
        sources: where each field's value is from: the names of one or more fields, and the text.
    """

    sources: dict[str, str]

    @model_validator(mode="after")
    def _each_field_has_a_source(self) -> _Sourced:
        named = {name for names in self.sources for name in names.split(", ")}
        given = self.model_fields_set - {"sources", "name", "unknown", "within_m"}
        if getattr(self, "corner", None) in ("any", "opposite"):
            given -= {"corner"}  # proposed, not published
        if given - named:
            raise wrong(f"{min(given - named)} has no source", "an entry in sources")
        return self


class PresetPlace(_Sourced):
    """Where a place is.

    Attributes:
        latitude: of the anchor, degrees, WGS84.
        longitude: of the anchor, degrees, WGS84.
        within_m: how far the true place may be from there, metres.
        streets: of streets that meet there the beginnings of their names, as they may be written;
            where they meet in an extract, within ``within_m``, is the anchor.
    """

    latitude: Annotated[float, Field(ge=-90, le=90, allow_inf_nan=False)]
    longitude: Annotated[float, Field(ge=-180, le=180, allow_inf_nan=False)]
    within_m: Annotated[float, Field(gt=0, le=2000)]
    streets: list[Annotated[list[str], Field(min_length=1)]] = Field(default_factory=list)


class PresetRegion(_Sourced):
    """How large the region is: ``radius_m`` of a circle about the anchor, metres."""

    radius_m: Annotated[float, Field(ge=20, le=500)]


class PresetTiming(_Sourced):
    """How often there is a frame: ``rate_hz``."""

    rate_hz: Annotated[float, Field(gt=0, le=100)]


class PresetFrame(_Sourced):
    """The frame that sensors' poses are published in.

    Attributes:
        crs: the coordinate reference system of the plane in which it lies, as PROJ names it.
        origin_m: its origin's easting and northing in there, metres.
        axes: the direction in that plane of x, y and z; ``up`` begins at the ground of the anchor.
    """

    crs: str
    origin_m: Annotated[list[Number], Field(min_length=2, max_length=2)]
    axes: Annotated[list[Literal["east", "north", "west", "south", "up"]], Field(min_length=3)]

    @field_validator("axes")
    @classmethod
    def _are_right_handed(cls, value: list[str]) -> list[str]:
        order = ["east", "north", "west", "south"]
        if value[2] != "up" or value[1] != order[(order.index(value[0]) + 1) % 4]:
            raise wrong(f"{value} are not right-handed with z up", "[north, west, up] or the like")
        return value


class PresetSensor(_Sourced):
    """A sensor: its model, and its pose as far as it is published.

    A sensor has a pose (``frame_SE3_sensor``), a place on the site (``east_m`` and so on), stands
    ``beside`` another, or its pole is proposed, at a ``corner`` of the junction.

    Attributes:
        name: unique in the preset.
        model: of the catalogue.
        columns: per turn.
        rate_hz: turns per second; that of the preset if it is not said here.
        frame_SE3_sensor: the upper three rows of the matrix that takes points of the sensor to the
            preset's frame.
        east_m: metres east of the anchor.
        north_m: metres north of it.
        height_m: above the ground there.
        pitch_deg: positive looks down.
        roll_deg: about the sensor's x.
        corner: in which quarter around the anchor its pole stands; ``opposite`` to the pole before.
        beside: the name of a sensor on the same pole.
        offset_m: from that one, east, north and up, metres.
        blind_deg: azimuths between which it sees nothing, counter-clockwise, in its own frame.
        unknown: what is not published, and what that means.
    """

    name: str
    model: str
    columns: int | None = None
    rate_hz: Number | None = None
    frame_SE3_sensor: Annotated[list[Row], Field(min_length=3, max_length=3)] | None = None  # noqa: N815
    east_m: Number | None = None
    north_m: Number | None = None
    height_m: Number | None = None
    pitch_deg: Number = 0.0
    roll_deg: Number = 0.0
    corner: Corner | None = None
    beside: str | None = None
    offset_m: Annotated[list[Number], Field(min_length=3, max_length=3)] | None = None
    blind_deg: Annotated[list[Number], Field(min_length=2, max_length=2)] | None = None
    unknown: dict[str, str] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _has_one_place(self) -> PresetSensor:
        placed = [
            self.frame_SE3_sensor is not None,
            None not in (self.east_m, self.north_m, self.height_m),
            self.corner is not None,
            None not in (self.beside, self.offset_m),
        ]
        if sum(placed) != 1:
            raise wrong(f"{self.name} is placed {sum(placed)} times", "one pose, place or corner")
        return self

    @property
    def is_placed(self) -> bool:
        """Whether its place is published, and not proposed."""
        return self.corner is None and self.beside is None


class PresetTraffic(_Sourced):
    """The traffic, by one of two measures.

    Attributes:
        per_hour: how many come per hour, by class.
        boxes_per_frame: how many are seen at a time, by class, where nobody counted who comes.
    """

    per_hour: dict[str, Annotated[int, Field(ge=0)]] | None = None
    boxes_per_frame: dict[str, Annotated[float, Field(ge=0)]] | None = None

    @field_validator("per_hour", "boxes_per_frame")
    @classmethod
    def _classes_are_known(cls, value: dict[str, float] | None) -> dict[str, float] | None:
        unknown = set(value or {}) - set(ACTOR_CLASSES)
        if unknown:
            raise wrong(f"{min(unknown)} is no class", "one of " + ", ".join(ACTOR_CLASSES))
        return value


class Preset(Strict):
    """A place at which a dataset was recorded.

    Attributes:
        name: what it is called on the command line.
        title: streets and town.
        country: code of ISO 3166.
        recording: the dataset, and who made it.
        licence: of the recording; nothing of it is here.
        homepage: of the recording.
        place: where it is; ``None`` where that is not published.
        region: how large.
        frame: of the sensors' poses, where they have any.
        timing: how often.
        sensors: at least one.
        traffic: as far as it was measured.
        unknown: what is not published, in sentences.
    """

    name: str
    title: str
    country: Annotated[str, Field(pattern="^[A-Z]{2}$")]
    recording: str
    licence: str
    homepage: str
    place: PresetPlace | None = None
    region: PresetRegion
    frame: PresetFrame | None = None
    timing: PresetTiming
    sensors: Annotated[list[PresetSensor], Field(min_length=1)]
    traffic: PresetTraffic | None = None
    unknown: Annotated[list[str], Field(min_length=1)]

    @model_validator(mode="after")
    def _names_what_it_has(self) -> Preset:
        seen: list[str] = []
        for sensor in self.sensors:
            if sensor.beside is not None and sensor.beside not in seen:
                raise wrong(f"{sensor.name} is beside {sensor.beside!r}", "a sensor before it")
            if sensor.frame_SE3_sensor is not None and self.frame is None:
                raise wrong(f"{sensor.name} has a pose in no frame", "frame")
            seen.append(sensor.name)
        return self

    @property
    def unknown_of_sensors(self) -> Iterator[tuple[str, str]]:
        """What is not published of the sensors: the sensor's name, and the sentence."""
        for sensor in self.sensors:
            for text in sensor.unknown.values():
                yield sensor.name, text


def preset_names() -> tuple[str, ...]:
    """Return the names of the presets, sorted."""
    return tuple(sorted(_files()))


@cache
def _files() -> Mapping[str, Path]:
    folder = Path(str(files("urbantwin.site.presets")))
    return {path.stem: path for path in folder.glob("*.yaml")}


@cache
def preset(name: str) -> Preset:
    """Return the preset of a name; case, blanks and underscores do not matter.

    Raises:
        InputError: there is none; the error names the nearest.
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
    return read_document(_files()[plain], kind="a preset").validated(Preset)
