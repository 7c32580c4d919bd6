"""Background files (``.npz``), and rigs whose sensors use them."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from urbantwin.artefact import replaced_file
from urbantwin.artefact.arrays import ArrayOf, checked_arrays, read_arrays
from urbantwin.artefact.document import json_value
from urbantwin.artefact.manifest import Part, validated
from urbantwin.errors import InputError
from urbantwin.lidar.background import IMAGES, MeasuredBackground, Stirring
from urbantwin.lidar.rig import MountedSensor, Rig

__all__ = [
    "load_backgrounds",
    "named_background",
    "rig_with_backgrounds",
    "save_backgrounds",
    "with_background",
]

_EXPECTED = "a background that urbantwin measured"
_FORMAT = 1
_MOST = {"range_m": 2000.0, "sigma_m": 100.0, "share": 1.0, "intensity": 1.0}
#: Most patches of vegetation of a sensor.
_MOST_PATCHES = 1_000_000
#: Rates that differ by less are equal.
_SAME_RATE_HZ = 0.01
#: Least share of beams with a range; of the demo's sensor it is 0.62.
_LEAST_KNOWN = 0.1


class _Sensor(Part):
    name: str
    model: str
    turns_per_second: Annotated[float, Field(gt=0, le=10_000)] | None
    stirring_lasts_s: Annotated[float, Field(ge=0, le=1e6)] | None = None


class _About(Part):
    kind: Literal["background"]
    format: Literal[1]
    sensors: list[_Sensor]


def save_backgrounds(path: Path, measured: Iterable[MeasuredBackground]) -> None:
    """Write backgrounds as an ``.npz``, atomically.

    ``about`` is JSON: names, models, channels, columns and turns per second of the sensors, and how
    long vegetation keeps its state. The images of sensor n are ``n.range_m`` and so on, its
    vegetation ``n.stirring.beam``, ``.patch``, ``.range_m`` and ``.intensity`` (-1: unknown).
    """
    arrays, about = {}, []
    for number, background in enumerate(measured):
        rate = background.turns_per_second
        about.append(
            {
                "name": background.name,
                "model": background.model,
                "channels": background.shape[0],
                "columns": background.shape[1],
                "turns_per_second": rate if np.isfinite(rate) else None,
            }
        )
        for name in (*IMAGES, "looks"):
            arrays[f"{number}.{name}"] = getattr(background, name)
        if background.stirring is not None:
            about[-1]["stirring_lasts_s"] = background.stirring.lasts_s
            for name in _stirring_of(background):
                arrays[f"{number}.stirring.{name}"] = np.nan_to_num(
                    getattr(background.stirring, name), nan=-1
                )
    header = {"kind": "background", "format": _FORMAT, "sensors": about}
    with replaced_file(path, kind="background") as scratch, scratch.open("wb") as stream:
        np.savez_compressed(stream, about=np.array(json.dumps(header)), **arrays)


def load_backgrounds(path: Path) -> list[MeasuredBackground]:
    """Read a background file.

    Raises:
        InputError: missing or damaged file, images of unequal size, or values out of bounds.
    """
    arrays = read_arrays(path, _EXPECTED)
    about = arrays.get("about")
    if about is None or about.dtype.kind != "U" or about.ndim:
        raise InputError("is missing", file=path, place="about", expected=_EXPECTED)
    value = json_value(str(about), file=path, expected=_EXPECTED)
    header = validated(value, _About, file=path, expected=_EXPECTED, within="about")
    backgrounds = []
    for number, entry in enumerate(header.sensors):
        # Images made by hand may have any numeric type.
        images = {
            name: arrays[f"{number}.{name}"]
            for name in (*IMAGES, "looks")
            if f"{number}.{name}" in arrays and arrays[f"{number}.{name}"].dtype.kind in "fiu"
        }
        lacking = [name for name in (*IMAGES, "looks") if name not in images]
        if lacking:
            problem = f"lacks {', '.join(lacking)}"
            raise InputError(problem, file=path, place=entry.name or None, expected=_EXPECTED)
        with np.errstate(over="ignore", invalid="ignore"):  # refused as out of bounds
            background = MeasuredBackground(
                np.asarray(images["range_m"], np.float32),
                np.asarray(images["sigma_m"], np.float32),
                np.asarray(images["share"], np.float32),
                np.asarray(images["intensity"], np.float32),
                np.asarray(images["looks"], np.int32),
                entry.model,
                float("nan") if entry.turns_per_second is None else entry.turns_per_second,
                entry.name,
            )
        _check(background, path)
        if entry.stirring_lasts_s is not None:
            stirring = _stirring(background, arrays, f"{number}.stirring.", path)
            stirring = replace(stirring, lasts_s=entry.stirring_lasts_s)
            background = replace(background, stirring=stirring)
        backgrounds.append(background)
    return backgrounds


def _stirring_of(background: MeasuredBackground) -> dict[str, ArrayOf]:
    return {
        "beam": ArrayOf("i4", ("beams",), most=float(np.prod(background.shape)) - 1, least=0),
        "patch": ArrayOf("i4", ("beams",), least=0, most=_MOST_PATCHES),
        "range_m": ArrayOf("f4", ("frames", "beams"), least=0, most=_MOST["range_m"]),
        "intensity": ArrayOf("f4", ("frames", "beams"), least=-1, most=1),
    }


def _stirring(
    background: MeasuredBackground, arrays: Mapping[str, NDArray[Any]], within: str, path: Path
) -> Stirring:
    form = _stirring_of(background)
    present = {name: arrays[within + name] for name in form if within + name in arrays}
    checked_arrays(present, form, file=path, expected=_EXPECTED, within=within)
    beam, patch, range_m, intensity = (
        np.asarray(present[name], kind.kind) for name, kind in form.items()
    )
    if not len(range_m) or (np.diff(beam) <= 0).any():
        raise InputError(
            "are not ascending beams in one frame or more",
            file=path,
            place=f"{within}beam",
            expected=_EXPECTED,
        )
    return Stirring(beam, patch, range_m, np.where(intensity < 0, np.nan, intensity))


def _check(background: MeasuredBackground, path: Path) -> None:
    size = background.range_m.shape
    sizes = [getattr(background, name).shape for name in IMAGES]
    if len(size) != 3 or not background.range_m.size or any(each != size for each in sizes):
        raise InputError("holds images of different sizes", file=path, expected=_EXPECTED)
    if background.looks.size and background.looks.shape != size[1:]:
        raise InputError("holds images of different sizes", file=path, expected=_EXPECTED)
    if background.looks.min(initial=0) < 0:
        raise InputError(
            "has a value out of bounds", file=path, place="looks", expected="0 or more"
        )
    for name, most in _MOST.items():
        values = getattr(background, name)
        good = (values >= 0) & (values <= most)
        if name != "range_m":
            good |= np.isnan(values)
        if not good.all():
            raise InputError(
                "has a value out of bounds", file=path, place=name, expected=f"0 to {most:g}"
            )


def rig_with_backgrounds(rig: Rig, given: Sequence[str], *, fused: bool = False) -> Rig:
    """Assign measured backgrounds to the sensors of a rig.

    Args:
        rig: the rig.
        given: ``NAME=FILE``, or ``FILE`` for a rig of one sensor or a file with the sensors' names.
        fused: use the modelled scene for beams without a measured range.

    Raises:
        InputError: invalid file, a sensor that is not in the rig or in the file, two backgrounds
            for one sensor, a background of another model, or one with hardly any ranges.
    """
    chosen: dict[str, tuple[MeasuredBackground, Path]] = {}
    names = [background.name for background in rig.sensors]
    for text in given:
        name, path = named_background(text)
        backgrounds = load_backgrounds(path)
        if name is not None:
            backgrounds = _of_sensor(backgrounds, name, path)
        elif len(backgrounds) == len(names) == 1:
            backgrounds = [replace(backgrounds[0], name=names[0])]
        for background in backgrounds:
            if background.name not in names:
                owner = (
                    f"of {background.name!r}" if background.name else "of a sensor without a name"
                )
                raise InputError(
                    f"has a background {owner}, which is not in the rig",
                    file=path,
                    expected=" or ".join(f"{each}={path.name}" for each in names),
                )
            if background.name in chosen:
                raise InputError(
                    f"{background.name!r} has a background twice",
                    file=path,
                    expected="one for a sensor",
                )
            chosen[background.name] = (replace(background, fused=fused), path)
    for name, (background, path) in chosen.items():
        share = float(background.known.mean()) if background.known.size else 0.0
        if share < _LEAST_KNOWN and not fused:
            raise InputError(
                f"has ranges on {share:.0%} of the beams of {name}: frames would be empty",
                file=path,
                expected=f"{_LEAST_KNOWN:.0%} or more; or --fuse, to see the twin beside it",
            )
        rig = with_background(rig, background, sensor=name, file=path)
    return rig


def named_background(text: str) -> tuple[str | None, Path]:
    """Split ``[NAME=]FILE`` into the sensor's name (``None`` if absent) and the file."""
    name, equals, rest = text.partition("=")
    named = bool(equals) and "/" not in name
    return (name, Path(rest)) if named else (None, Path(text))


def _of_sensor(
    backgrounds: list[MeasuredBackground], name: str, path: Path
) -> list[MeasuredBackground]:
    if len(backgrounds) == 1:
        return [replace(backgrounds[0], name=name)]
    matching = [background for background in backgrounds if background.name == name]
    if not matching:
        raise InputError(
            f"has no background of {name!r}",
            file=path,
            expected=" or ".join(background.name for background in backgrounds),
        )
    return matching


def with_background(
    rig: Rig,
    measured: MeasuredBackground,
    *,
    sensor: str | None = None,
    file: str | Path | None = None,
) -> Rig:
    """Assign a measured background to one fixed sensor of a rig.

    Args:
        rig: the rig.
        measured: the background.
        sensor: name of the sensor; the rig's first if not given.
        file: the background's file, for errors.

    Raises:
        InputError: the sensor is mounted on a vehicle, sways or has a non-repeating pattern, or the
            background was measured by another model.
    """
    sensors = list(rig.sensors)
    number = 0 if sensor is None else [mounted.name for mounted in sensors].index(sensor)
    mounted = sensors[number]
    if rig.ride is not None or mounted.sway is not None or mounted.sensor.pattern is not None:
        raise InputError(
            f"is of a static sensor, and {mounted.name} does not",
            file=file,
            expected="a sensor without ride or sway, whose beams repeat",
        )
    expected = _described(
        mounted.sensor.name, (mounted.sensor.channels, mounted.columns), mounted.turns_per_second
    )
    actual = _described(measured.model, measured.shape, measured.turns_per_second)
    if not _is_of(measured, mounted):
        raise InputError(
            f"was measured by {actual}",
            file=file,
            place=mounted.name,
            expected=f"{expected}, as in the rig",
        )
    sensors[number] = replace(mounted, measured=measured)
    return replace(rig, sensors=tuple(sensors))


def _is_of(measured: MeasuredBackground, mounted: MountedSensor) -> bool:
    rate = measured.turns_per_second
    return (
        measured.shape == (mounted.sensor.channels, mounted.columns)
        and measured.model in ("", mounted.sensor.name)
        and not abs(rate - mounted.turns_per_second) > _SAME_RATE_HZ  # nan: not known
    )


def _described(model: str, shape: tuple[int, int], rate_hz: float) -> str:
    channels, columns = shape
    turning = f" at {rate_hz:g} Hz" if np.isfinite(rate_hz) else ""
    return f"{model or 'a sensor'} with {channels} channels by {columns} columns{turning}"
