"""The sensor catalogue: one YAML file per sensor, read into a ``Sensor``.

The catalogue's files stand in ``urbantwin/lidar/sensors``; a person's own file of the same form
works wherever a model's name does. Every number in the catalogue names its source, and what is
not published is ``null``: nothing is guessed in a file. Consumers use the documented fallbacks
``Sensor.assumed_*``.

Signs. Elevation is positive up. An azimuth offset is **counter-clockwise positive** seen from
above, in the sensor frame (x forward, y left, z up), whatever the maker's own convention:

- Velodyne calibration files: the driver (ros-drivers/velodyne ``rawdata.cc``) computes the
  direction at clockwise angle ``encoder - rot_correction``, so our offset is ``+rot_correction``.
- Hesai correction files: the driver (HesaiLidar_General_ROS ``pandarGeneral_internal.cc``) adds
  the file's azimuth to a clockwise encoder angle, so our offset is ``-Azimuth``.
- Ouster metadata: the sensor's manual ("Lidar Range to XYZ") turns counter-clockwise by
  ``-beam_azimuth_angles``, so our offset is ``-beam_azimuth_angles``.
"""

from __future__ import annotations

import difflib
import re
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import yaml
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from urbantwin.errors import InputError

__all__ = ["Sensor", "load_sensor", "sensor", "sensor_names"]

_ASSUMED_RANGE_SIGMA_M = 0.02
_ASSUMED_RANGE_RESOLUTION_M = 0.001
_ASSUMED_RANGE_MIN_M = 0.5
_ASSUMED_WAVELENGTH_NM = 905.0
_ASSUMED_REFLECTIVITY = 0.1


@dataclass(frozen=True, eq=False)
class Sensor:
    """A spinning LiDAR: where its beams point and what its maker says of its ranges.

    ``None`` means that the maker does not publish the number.

    Attributes:
        name: the model's name.
        maker: who makes it.
        elevation_deg: (C,) float64, elevation of each channel, degrees, positive up, in the
            order in which the maker numbers the channels.
        azimuth_offset_deg: (C,) float64, direction of each channel relative to the encoder's
            angle, degrees, counter-clockwise positive.
        columns: firings per turn by default.
        columns_options: every number of firings per turn that the sensor offers.
        rate_hz: turns per second by default.
        rate_options: every rate that the sensor offers.
        range_min_m: nearest distance that is measured.
        range_max_m: farthest distance that is reported.
        reference_reflectivity: diffuse reflectivity (0..1) that ``reference_range_m`` is for.
        reference_range_m: distance up to which such a target is detected.
        range_sigma_m: standard deviation of one distance measurement.
        range_resolution_m: step of the reported distance.
        wavelength_nm: of the laser.
        spin: ``cw`` or ``ccw`` seen from above.
        sources: field -> document that the value is from.
        aliases: other names of the model.
    """

    name: str
    maker: str
    elevation_deg: NDArray[np.float64]
    azimuth_offset_deg: NDArray[np.float64]
    columns: int
    columns_options: tuple[int, ...]
    rate_hz: float
    rate_options: tuple[float, ...]
    range_min_m: float | None
    range_max_m: float
    reference_reflectivity: float | None
    reference_range_m: float | None
    range_sigma_m: float | None
    range_resolution_m: float | None
    wavelength_nm: float | None
    spin: Literal["cw", "ccw"]
    sources: dict[str, str]
    aliases: tuple[str, ...] = ()

    @property
    def channels(self) -> int:
        """Number of channels, C."""
        return len(self.elevation_deg)

    @property
    def assumed_range_min_m(self) -> float:
        """``range_min_m``, or 0.5 m where it is not published."""
        return _ASSUMED_RANGE_MIN_M if self.range_min_m is None else self.range_min_m

    @property
    def assumed_range_sigma_m(self) -> float:
        """``range_sigma_m``, or 2 cm where it is not published (the usual class of accuracy)."""
        return _ASSUMED_RANGE_SIGMA_M if self.range_sigma_m is None else self.range_sigma_m

    @property
    def assumed_range_resolution_m(self) -> float:
        """``range_resolution_m``, or 1 mm where it is not published."""
        if self.range_resolution_m is None:
            return _ASSUMED_RANGE_RESOLUTION_M
        return self.range_resolution_m

    @property
    def assumed_wavelength_nm(self) -> float:
        """``wavelength_nm``, or 905 nm where it is not published."""
        return _ASSUMED_WAVELENGTH_NM if self.wavelength_nm is None else self.wavelength_nm

    @property
    def assumed_reference(self) -> tuple[float, float]:
        """Reflectivity and the distance up to which it is detected.

        Where the maker publishes none, a 10 % target is taken to be seen up to half of
        ``range_max_m``: about what the makers that publish both state.
        """
        if self.reference_reflectivity is None or self.reference_range_m is None:
            return _ASSUMED_REFLECTIVITY, self.range_max_m / 2
        return self.reference_reflectivity, self.reference_range_m


_Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class _SensorFile(BaseModel):
    """The form of a sensor's file."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: Annotated[str, Field(min_length=1)]
    maker: str
    aliases: tuple[str, ...] = ()
    spin: Literal["cw", "ccw"] = "cw"
    columns: Annotated[int, Field(ge=1, le=65536)]
    columns_options: tuple[Annotated[int, Field(ge=1, le=65536)], ...]
    rate_hz: _Positive
    rate_options: tuple[_Positive, ...]
    range_min_m: Annotated[float, Field(ge=0, allow_inf_nan=False)] | None
    range_max_m: _Positive
    reference_reflectivity: Annotated[float, Field(gt=0, le=1)] | None
    reference_range_m: _Positive | None
    range_sigma_m: Annotated[float, Field(ge=0, allow_inf_nan=False)] | None
    range_resolution_m: Annotated[float, Field(ge=0, allow_inf_nan=False)] | None
    wavelength_nm: _Positive | None
    sources: dict[str, str] = Field(default_factory=dict)
    channels: Annotated[
        tuple[
            tuple[
                Annotated[float, Field(ge=-90, le=90, allow_inf_nan=False)],
                Annotated[float, Field(ge=-180, le=180, allow_inf_nan=False)],
            ],
            ...,
        ],
        Field(min_length=1, max_length=4096),
    ]

    @model_validator(mode="after")
    def _agree(self) -> _SensorFile:
        if self.columns not in self.columns_options:
            raise ValueError(f"columns: {self.columns} is not among columns_options")
        if self.rate_hz not in self.rate_options:
            raise ValueError(f"rate_hz: {self.rate_hz} is not among rate_options")
        if self.range_min_m is not None and self.range_min_m >= self.range_max_m:
            raise ValueError("range_min_m: is not below range_max_m")
        if (self.reference_reflectivity is None) != (self.reference_range_m is None):
            raise ValueError("reference_range_m: needs reference_reflectivity, and the reverse")
        return self

    def sensor(self) -> Sensor:
        values = self.model_dump(exclude={"channels", "sources"})
        table = np.array(self.channels, np.float64)
        table.setflags(write=False)
        return Sensor(
            **values,
            elevation_deg=table[:, 0],
            azimuth_offset_deg=table[:, 1],
            sources=dict(self.sources),
        )


def sensor_names() -> tuple[str, ...]:
    """Return the names of the catalogue's sensors, by maker and then by name."""
    return tuple(entry.name for entry in _catalogue())


def sensor(name: str | Path) -> Sensor:
    """Return the sensor of that name, or of a person's own file.

    Case, dashes, underscores, dots and blanks do not matter: ``os1 128`` is ``OS1-128``.

    Args:
        name: a name or alias of the catalogue, or the path of a ``.yaml`` file.

    Raises:
        InputError: no sensor has that name (the error lists the nearest), or the file is wrong.
    """
    if str(name).lower().endswith((".yaml", ".yml")):
        return load_sensor(Path(name))
    index = _index()
    key = _key(str(name))
    if key in index:
        return index[key]
    near = difflib.get_close_matches(key, index, n=8, cutoff=0.6)
    names = list(dict.fromkeys(index[match].name for match in near))[:4]
    raise InputError(
        f"unknown sensor {str(name)!r}",
        expected=f"one of {', '.join(names or sensor_names())}"
        + (" (`urbantwin sensors` lists them all)" if names else "")
        + ", or the path of a .yaml file",
    )


def load_sensor(path: Path) -> Sensor:
    """Read one sensor from a file of the catalogue's form.

    Raises:
        InputError: the file is missing, is not YAML or breaks the form; names the field.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise InputError("not found", file=path, expected="a sensor's YAML file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot be read ({error})", file=path) from None
    return _parse(text, path)


def _parse(text: str, origin: Path | str) -> Sensor:
    try:
        # The C loader reads the whole catalogue five times as fast; not every build has it.
        value = yaml.load(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        raise InputError(
            f"is not YAML ({getattr(error, 'problem', error)})",
            file=origin,
            place=None if mark is None else f"line {mark.line + 1}",
        ) from None
    try:
        return _SensorFile.model_validate(value).sensor()
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        problem = first["msg"].removeprefix("Value error, ")
        raise InputError(
            problem, file=origin, place=place or None, expected="the form of a sensor's file"
        ) from None


@cache
def _catalogue() -> tuple[Sensor, ...]:
    def is_sensor(entry: Traversable) -> bool:
        return entry.name.endswith(".yaml")

    folder = files(__package__).joinpath("sensors")
    entries = [_parse(e.read_text(), e.name) for e in folder.iterdir() if is_sensor(e)]
    return tuple(sorted(entries, key=lambda entry: (entry.maker, _natural(entry.name))))


@cache
def _index() -> dict[str, Sensor]:
    index = {_key(alias): entry for entry in _catalogue() for alias in entry.aliases}
    return index | {_key(entry.name): entry for entry in _catalogue()}


def _key(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower())


def _natural(name: str) -> tuple[tuple[int, str], ...]:
    parts = re.findall(r"\d+|\D+", name)
    return tuple((int(part), "") if part.isdigit() else (-1, part) for part in parts)
