"""``place.yaml``: candidate places, sensor models with prices, and objectives."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Annotated, Any, Literal

import shapely
from pydantic import AfterValidator, Field, field_validator, model_validator

from urbantwin.errors import InputError
from urbantwin.lidar.catalogue import Sensor, sensor
from urbantwin.site.conditions import Conditions, Strict
from urbantwin.site.rig import FARTHEST_M
from urbantwin.site.yaml_document import read_document, wrong
from urbantwin.studies.placement.measure import MEASURES

__all__ = ["CandidateSpec", "MountKind", "OwnPlace", "PlaceSpec", "load_place_spec"]

#: Supports of a sensor: a mapped pole, lamp or mast; a signal pole; a facade; a new pole.
MountKind = Literal["pole", "signal", "facade", "new-pole"]

_Offset = Annotated[float, Field(ge=-FARTHEST_M, le=FARTHEST_M, allow_inf_nan=False)]
_Price = Annotated[float, Field(ge=0.0, le=1e9, allow_inf_nan=False)]
_Height = Annotated[float, Field(le=60.0, allow_inf_nan=False)]
_Turn = Annotated[float, Field(ge=-180.0, le=180.0, allow_inf_nan=False)]
_Tilt = Annotated[float, Field(ge=-45.0, le=90.0, allow_inf_nan=False)]
_Place = Annotated[list[_Offset], Field(min_length=2, max_length=2)]


def _above_ground(value: float) -> float:
    if value <= 0:
        raise wrong(f"{value:g} m is under the ground", "heights above the ground, in m")
    return value


_Heights = Annotated[
    list[Annotated[_Height, AfterValidator(_above_ground)]], Field(min_length=1, max_length=20)
]


class OwnPlace(Strict):
    """A place given by the user.

    Attributes:
        name: unique name.
        east_m: metres east of the anchor.
        north_m: metres north of the anchor.
        kind: existing support; ``new-pole`` if a pole has to be set.
        heights_m: heights above the ground, metres; the common heights if not given.
    """

    name: Annotated[str, Field(min_length=1, max_length=60)]
    east_m: _Offset
    north_m: _Offset
    kind: MountKind = "new-pole"
    heights_m: _Heights | None = None


class CandidateSpec(Strict):
    """Candidate places of sensors.

    Attributes:
        kinds: kinds searched in the twin; empty for ``places`` only.
        within_m: largest distance from the centre, metres.
        most: number of places of each kind, with the best view of lanes and crossings.
        spacing_m: spacing of new poles, and along facades, metres.
        area: corners of a polygon for new poles; beside the carriageways if not given.
        places: places given by the user.
    """

    kinds: list[MountKind] = Field(
        default_factory=lambda: list[MountKind](("pole", "signal", "facade", "new-pole"))
    )
    within_m: Annotated[float, Field(gt=0.0, le=300.0)] = 45.0
    most: Annotated[int, Field(ge=1, le=200)] = 8
    spacing_m: Annotated[float, Field(ge=1.0, le=100.0)] = 8.0
    area: Annotated[list[_Place], Field(min_length=3, max_length=1000)] | None = None
    places: Annotated[list[OwnPlace], Field(max_length=500)] = Field(default_factory=list)

    @field_validator("area")
    @classmethod
    def _area_is_one(cls, value: list[list[float]] | None) -> list[list[float]] | None:
        if value is not None:
            outline = shapely.Polygon(value)
            if not outline.is_valid:
                raise wrong("is an outline that crosses itself", "corners in their order")
            if outline.area <= 0:
                raise wrong("is an outline without an area", "corners around an area")
        return value

    @model_validator(mode="after")
    def _area_is_for_new_poles(self) -> CandidateSpec:
        if self.area is not None and "new-pole" not in self.kinds:
            raise wrong("an area, and no new poles", "new-pole among kinds")
        return self

    @field_validator("places")
    @classmethod
    def _names_are_unique(cls, value: list[OwnPlace]) -> list[OwnPlace]:
        for name, count in Counter(one.name for one in value).items():
            if count > 1:
                raise wrong(f"{count} places are named {name!r:.60}", "a name for each")
        return value


class ModelSpec(Strict):
    """A sensor model with its price.

    Attributes:
        model: name in the catalogue, or a sensor's file.
        price: price of one sensor.
        columns: firings per turn; the model's default if not given.
    """

    model: Annotated[str, Field(min_length=1)]
    price: _Price
    columns: Annotated[int, Field(gt=0, le=16384)] | None = None


class CostSpec(Strict):
    """Costs besides the sensors' prices, in the same currency.

    Attributes:
        new_pole: a pole with foundation and power, once for all sensors on it.
        bracket: a bracket on a pole, mast or facade, per sensor.
    """

    new_pole: _Price = 6000.0
    bracket: _Price = 800.0


class CountSpec(Strict):
    """Number of sensors of a layout.

    Attributes:
        least: smallest number.
        most: largest number.
    """

    least: Annotated[int, Field(ge=1, le=16)] = 1
    most: Annotated[int, Field(ge=1, le=16)] = 3

    @model_validator(mode="after")
    def _in_order(self) -> CountSpec:
        if self.most < self.least:
            raise wrong(f"at most {self.most} and at least {self.least} sensors", "most >= least")
        return self


def _usual_models() -> list[ModelSpec]:
    # Rough prices, not quotes, so that cost is meaningful without a file.
    return [
        ModelSpec(model="VLP-16", price=4000.0),
        ModelSpec(model="OS1-32", price=6000.0),
        ModelSpec(model="OS1-128", price=14000.0),
    ]


class PlaceSpec(Strict):
    """Settings of a search for layouts.

    Attributes:
        middle_m: centre of the junction, east and north of the anchor, metres.
        candidates: candidate places of sensors.
        heights_m: heights above the ground, metres; on lower poles and walls only those below the
            top.
        yaw_deg: headings relative to the centre of the junction, degrees counter-clockwise.
        tilt_deg: downward pitches, degrees.
        models: available models.
        costs: further costs.
        sensors: number of sensors.
        budget: largest cost of a layout.
        objectives: names of `measure.MEASURES` to optimise.
        rate_hz: frames per second.
        reach_m: largest distance from the centre of actors that count, and of their voxels, metres.
        step_s: time between the evaluated moments of the motion, seconds.
        voxel_m: edge of the voxels of published surrogates, metres.
        conditions: weather and sun.
    """

    middle_m: _Place = Field(default_factory=lambda: [0.0, 0.0])
    candidates: CandidateSpec = CandidateSpec()
    heights_m: _Heights = Field(default_factory=lambda: [5.0, 7.0])
    yaw_deg: Annotated[list[_Turn], Field(min_length=1, max_length=36)] = Field(
        default_factory=lambda: [0.0]
    )
    tilt_deg: Annotated[list[_Tilt], Field(min_length=1, max_length=36)] = Field(
        default_factory=lambda: [0.0, 8.0, 16.0]
    )
    models: Annotated[list[ModelSpec], Field(min_length=1, max_length=50)] = Field(
        default_factory=_usual_models
    )
    costs: CostSpec = CostSpec()
    sensors: CountSpec = CountSpec()
    budget: _Price | None = None
    objectives: Annotated[list[str], Field(min_length=1, max_length=6)] = Field(
        default_factory=lambda: ["cost", "seen_20", "seen_5_one_failed"]
    )
    rate_hz: Annotated[float, Field(gt=0.0, le=100.0)] = 10.0
    reach_m: Annotated[float, Field(gt=0.0, le=1000.0)] = 60.0
    step_s: Annotated[float, Field(ge=0.05, le=60.0)] = 1.0
    voxel_m: Annotated[float, Field(ge=0.25, le=5.0)] = 1.0
    conditions: Conditions = Conditions()

    @field_validator("objectives")
    @classmethod
    def _objectives_are_known(cls, value: list[str]) -> list[str]:
        for name in value:
            if name not in MEASURES:
                raise wrong(f"{name!r:.40} is no objective", "one of " + ", ".join(MEASURES))
        if len(set(value)) < len(value):
            raise wrong("an objective is named twice", "each once")
        return value

    def written(self) -> dict[str, Any]:
        """Return the settings as stored in a file, defaults filled in."""
        return self.model_dump(exclude_none=True, by_alias=True)

    def sensors_of_models(self, file: Path | None = None) -> tuple[Sensor, ...]:
        """Return the catalogue's entry of each model.

        Args:
            file: ``place.yaml``; sensor files are relative to its folder.

        Raises:
            InputError: a model is unknown; names its field.
        """
        found = []
        for number, one in enumerate(self.models):
            place = f"models[{number}].model"
            try:
                found.append(sensor(one.model, folder=None if file is None else file.parent))
            except InputError as error:
                if error.file is not None:
                    raise
                raise InputError(
                    error.problem, file=file, place=place, expected=error.expected
                ) from None
        return tuple(found)


def load_place_spec(path: Path) -> PlaceSpec:
    """Read a ``place.yaml``.

    Raises:
        InputError: the file is missing or wrong; names file, field and line.
    """
    return read_document(path, kind="a placement").validated(PlaceSpec)
