"""Background files (``.npz``), and the rig whose sensors they were measured by."""

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
#: What stirs before a sensor of so many beams; an intensity of -1 is not known.
_MOST_PATCHES = 1_000_000
#: Rates that differ by less are one.
_SAME_RATE_HZ = 0.01
#: Share of the beams below which a background is of hardly anything (of the demo's sensor: 0.62).
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
    """Write them as an ``.npz``; the file appears whole or not at all.

    ``about`` is JSON: the sensors' names, models, channels, columns and turns per second, and how
    long lasts what stirs. The images of the n-th are ``n.range_m`` and so on; what stirs is
    ``n.stirring.beam``, ``.patch``, ``.range_m`` and ``.intensity``.
    """
    arrays, about = {}, []
    for number, one in enumerate(measured):
        rate = one.turns_per_second
        about.append(
            {
                "name": one.name,
                "model": one.model,
                "channels": one.shape[0],
                "columns": one.shape[1],
                "turns_per_second": rate if np.isfinite(rate) else None,
            }
        )
        for name in (*IMAGES, "looks"):
            arrays[f"{number}.{name}"] = getattr(one, name)
        if one.stirring is not None:
            about[-1]["stirring_lasts_s"] = one.stirring.lasts_s
            for name in _stirring_of(one):
                arrays[f"{number}.stirring.{name}"] = np.nan_to_num(
                    getattr(one.stirring, name), nan=-1
                )
    told = {"kind": "background", "format": _FORMAT, "sensors": about}
    with replaced_file(path, kind="background") as scratch, scratch.open("wb") as stream:
        np.savez_compressed(stream, about=np.array(json.dumps(told)), **arrays)


def load_backgrounds(path: Path) -> list[MeasuredBackground]:
    """Read them.

    Raises:
        InputError: missing, damaged, or images of other sizes, or with values out of bounds.
    """
    arrays = read_arrays(path, _EXPECTED)
    about = arrays.get("about")
    if about is None or about.dtype.kind != "U" or about.ndim:
        raise InputError("is missing", file=path, place="about", expected=_EXPECTED)
    value = json_value(str(about), file=path, expected=_EXPECTED)
    told = validated(value, _About, file=path, expected=_EXPECTED, within="about")
    found = []
    for number, one in enumerate(told.sensors):
        # A background by hand may have any type of numbers.
        images = {
            name: arrays[f"{number}.{name}"]
            for name in (*IMAGES, "looks")
            if f"{number}.{name}" in arrays and arrays[f"{number}.{name}"].dtype.kind in "fiu"
        }
        lacking = [name for name in (*IMAGES, "looks") if name not in images]
        if lacking:
            problem = f"lacks {', '.join(lacking)}"
            raise InputError(problem, file=path, place=one.name or None, expected=_EXPECTED)
        with np.errstate(over="ignore", invalid="ignore"):  # refused as out of bounds
            background = MeasuredBackground(
                np.asarray(images["range_m"], np.float32),
                np.asarray(images["sigma_m"], np.float32),
                np.asarray(images["share"], np.float32),
                np.asarray(images["intensity"], np.float32),
                np.asarray(images["looks"], np.int32),
                one.model,
                float("nan") if one.turns_per_second is None else one.turns_per_second,
                one.name,
            )
        _check(background, path)
        if one.stirring_lasts_s is not None:
            stirring = _stirring(background, arrays, f"{number}.stirring.", path)
            stirring = replace(stirring, lasts_s=one.stirring_lasts_s)
            background = replace(background, stirring=stirring)
        found.append(background)
    return found


def _stirring_of(one: MeasuredBackground) -> dict[str, ArrayOf]:
    return {
        "beam": ArrayOf("i4", ("beams",), most=float(np.prod(one.shape)) - 1, least=0),
        "patch": ArrayOf("i4", ("beams",), least=0, most=_MOST_PATCHES),
        "range_m": ArrayOf("f4", ("frames", "beams"), least=0, most=_MOST["range_m"]),
        "intensity": ArrayOf("f4", ("frames", "beams"), least=-1, most=1),
    }


def _stirring(
    one: MeasuredBackground, arrays: Mapping[str, NDArray[Any]], within: str, path: Path
) -> Stirring:
    form = _stirring_of(one)
    mine = {name: arrays[within + name] for name in form if within + name in arrays}
    checked_arrays(mine, form, file=path, expected=_EXPECTED, within=within)
    beam, patch, range_m, intensity = (
        np.asarray(mine[name], kind.kind) for name, kind in form.items()
    )
    if not len(range_m) or (np.diff(beam) <= 0).any():
        raise InputError(
            "are not ascending beams in one frame or more",
            file=path,
            place=f"{within}beam",
            expected=_EXPECTED,
        )
    return Stirring(beam, patch, range_m, np.where(intensity < 0, np.nan, intensity))


def _check(one: MeasuredBackground, path: Path) -> None:
    size = one.range_m.shape
    sizes = [getattr(one, name).shape for name in IMAGES]
    if len(size) != 3 or not one.range_m.size or any(each != size for each in sizes):
        raise InputError("holds images of different sizes", file=path, expected=_EXPECTED)
    if one.looks.size and one.looks.shape != size[1:]:
        raise InputError("holds images of different sizes", file=path, expected=_EXPECTED)
    if one.looks.min(initial=0) < 0:
        raise InputError(
            "has a value out of bounds", file=path, place="looks", expected="0 or more"
        )
    for name, most in _MOST.items():
        values = getattr(one, name)
        good = (values >= 0) & (values <= most)
        if name != "range_m":
            good |= np.isnan(values)
        if not good.all():
            raise InputError(
                "has a value out of bounds", file=path, place=name, expected=f"0 to {most:g}"
            )


def rig_with_backgrounds(rig: Rig, given: Sequence[str], *, fused: bool = False) -> Rig:
    """Return a rig whose sensors see what a person's files say that they measured.

    Args:
        rig: as it stands.
        given: ``NAME=FILE``, or ``FILE`` for a rig of one sensor or with the sensors' own names.
        fused: beams without a measured range see the modelled scene.

    Raises:
        InputError: a file is none such, a sensor is not in the rig or in the file, is given
            twice, is another than the one that measured, or has ranges on hardly any beam.
    """
    chosen: dict[str, tuple[MeasuredBackground, Path]] = {}
    names = [one.name for one in rig.sensors]
    for text in given:
        name, path = named_background(text)
        found = load_backgrounds(path)
        if name is not None:
            found = _of_sensor(found, name, path)
        elif len(found) == len(names) == 1:
            found = [replace(found[0], name=names[0])]
        for one in found:
            if one.name not in names:
                whose = f"of {one.name!r}" if one.name else "of a sensor without a name"
                raise InputError(
                    f"has a background {whose}, which is not in the rig",
                    file=path,
                    expected=" or ".join(f"{each}={path.name}" for each in names),
                )
            if one.name in chosen:
                raise InputError(
                    f"{one.name!r} has a background twice", file=path, expected="one for a sensor"
                )
            chosen[one.name] = (replace(one, fused=fused), path)
    for name, (one, path) in chosen.items():
        share = float(one.known.mean()) if one.known.size else 0.0
        if share < _LEAST_KNOWN and not fused:
            raise InputError(
                f"has ranges on {share:.0%} of the beams of {name}: frames would be empty",
                file=path,
                expected=f"{_LEAST_KNOWN:.0%} or more; or --fuse, to see the twin beside it",
            )
        rig = with_background(rig, one, sensor=name, file=path)
    return rig


def named_background(text: str) -> tuple[str | None, Path]:
    """Return the sensor's name, if one is given, and the file of ``[NAME=]FILE``."""
    name, equals, rest = text.partition("=")
    named = bool(equals) and "/" not in name
    return (name, Path(rest)) if named else (None, Path(text))


def _of_sensor(found: list[MeasuredBackground], name: str, path: Path) -> list[MeasuredBackground]:
    if len(found) == 1:
        return [replace(found[0], name=name)]
    mine = [one for one in found if one.name == name]
    if not mine:
        raise InputError(
            f"has no background of {name!r}",
            file=path,
            expected=" or ".join(one.name for one in found),
        )
    return mine


def with_background(
    rig: Rig,
    measured: MeasuredBackground,
    *,
    sensor: str | None = None,
    file: str | Path | None = None,
) -> Rig:
    """Return a rig one of whose sensors, which stands still, sees a measured background.

    Args:
        rig: as it stands.
        measured: what it measured.
        sensor: its name; the rig's first if not given.
        file: for errors.

    Raises:
        InputError: it rides or sways, its pattern does not repeat, or the background is another
            sensor's.
    """
    sensors = list(rig.sensors)
    number = 0 if sensor is None else [one.name for one in sensors].index(sensor)
    one = sensors[number]
    if rig.ride is not None or one.sway is not None or one.sensor.pattern is not None:
        raise InputError(
            f"is of a sensor that stands still, and {one.name} does not",
            file=file,
            expected="a sensor without ride or sway, whose beams repeat",
        )
    mine = _described(one.sensor.name, (one.sensor.channels, one.columns), one.turns_per_second)
    its = _described(measured.model, measured.shape, measured.turns_per_second)
    if not _is_of(measured, one):
        raise InputError(
            f"was measured by {its}", file=file, place=one.name, expected=f"{mine}, as in the rig"
        )
    sensors[number] = replace(one, measured=measured)
    return replace(rig, sensors=tuple(sensors))


def _is_of(measured: MeasuredBackground, one: MountedSensor) -> bool:
    rate = measured.turns_per_second
    return (
        measured.shape == (one.sensor.channels, one.columns)
        and measured.model in ("", one.sensor.name)
        and not abs(rate - one.turns_per_second) > _SAME_RATE_HZ  # nan: not known
    )


def _described(model: str, shape: tuple[int, int], rate_hz: float) -> str:
    channels, columns = shape
    turning = f" at {rate_hz:g} Hz" if np.isfinite(rate_hz) else ""
    return f"{model or 'a sensor'} with {channels} channels by {columns} columns{turning}"
