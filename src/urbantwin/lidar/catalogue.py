"""The sensor catalogue: one YAML file per sensor, read into a ``Sensor``.

The files are in ``urbantwin/lidar/sensors``. Every number names its source; an unknown one is
``null`` with the reason. Sensors in the folder ``nominal`` have no public table of beam angles:
equal spacing, marked as such, stands in for it. A file of the user is accepted wherever a model's
name is: YAML of the same form (or with a scan pattern), the metadata of an Ouster sensor (JSON), or
the angle correction of a Hesai sensor (CSV).
"""

from __future__ import annotations

import difflib
import re
from functools import cache
from importlib.resources import files
from pathlib import Path

from urbantwin.errors import InputError
from urbantwin.lidar.hesai import hesai_sensor
from urbantwin.lidar.ouster import ouster_sensor
from urbantwin.lidar.sensor import Sensor
from urbantwin.lidar.sensor_file import (
    FORM,
    checked_sensor,
    parse_sensor,
    pattern_sensor,
    read_text,
    yaml_value,
)

__all__ = ["Sensor", "load_sensor", "nominal_sensor_names", "sensor", "sensor_names"]

_FILES = (".yaml", ".yml", ".json", ".csv")


def sensor_names() -> tuple[str, ...]:
    """Return the names of the catalogue's sensors, sorted by maker and name."""
    return tuple(entry.name for entry in _catalogue())


def nominal_sensor_names() -> tuple[str, ...]:
    """Return the names of sensors with nominal beam angles, sorted by maker and name.

    `sensor` accepts them too; recordings are never attributed to them.
    """
    return tuple(entry.name for entry in _catalogue("nominal"))


def sensor(name: str | Path, *, folder: Path | None = None) -> Sensor:
    """Return a sensor by name, or from a file.

    Case, dashes, underscores, dots and blanks are ignored: ``os1 128`` is ``OS1-128``.

    Args:
        name: name or alias in the catalogue, or a file that `load_sensor` reads.
        folder: folder in which a relative path is looked up before the current folder.

    Raises:
        InputError: unknown name (the error lists the nearest), or an invalid file.
    """
    text = str(name)
    if text.lower().endswith(".npz"):
        raise _is_a_pattern(Path(text))
    if text.lower().endswith(_FILES):
        model, path = _model_and_path(text)
        if folder is not None and (folder / path).is_file():
            path = folder / path
        return load_sensor(path, model=model)
    entry = _known(text)
    if entry is not None:
        return entry
    raise _unknown(text)


def load_sensor(path: Path, *, model: str | None = None) -> Sensor:
    """Read a sensor from a file.

    Args:
        path: ``.yaml`` (form of the catalogue), ``.json`` (metadata of an Ouster unit) or ``.csv``
            (angle correction of a Hesai unit).
        model: model from which a Hesai unit inherits all but its angles; by default the model that
            the file's name begins with.

    Raises:
        InputError: missing or invalid file; names the field or the line.
    """
    ending = path.suffix.lower()
    if model is not None and ending != ".csv":
        raise InputError(f"{model}: comes before a file that is not a .csv", file=path)
    if ending == ".json":
        return ouster_sensor(read_text(path, "an Ouster sensor's metadata"), path, _known)
    if ending == ".csv":
        text = read_text(path, "a Hesai sensor's angle correction")
        if re.search(r"^\s*time_s\s*,", text[:2000], re.MULTILINE):
            raise _is_a_pattern(path)
        return hesai_sensor(text, path, _hesai_model(path, model))
    value = yaml_value(read_text(path, "a sensor's YAML file"), path)
    if isinstance(value, dict) and "pattern" in value:
        return pattern_sensor(value, path)
    return checked_sensor(value, path, FORM)


def _is_a_pattern(path: Path) -> InputError:
    return InputError(
        "is a scan pattern, not a sensor",
        file=path,
        expected=f"a sensor's YAML file with pattern: {path.name}",
    )


def _model_and_path(text: str) -> tuple[str | None, Path]:
    """Split ``MODEL:PATH``; a model of one letter is a drive."""
    model, colon, path = text.partition(":")
    if colon and len(model) > 1 and "/" not in model and path:
        return model, Path(path)
    return None, Path(text)


def _hesai_model(path: Path, model: str | None) -> Sensor:
    if model is not None:
        named = _known(model)
        if named is None:
            raise _unknown(model)
        return named
    start = _key(path.stem)
    names = [name for name, entry in _index().items() if entry.maker == "Hesai"]
    fitting = max((name for name in names if start.startswith(name)), key=len, default=None)
    if fitting is None:
        raise InputError(
            "does not say which model it is of",
            file=path,
            expected=f"MODEL:PATH, for example Pandar64:{path.name}",
        )
    return _index()[fitting]


def _known(name: str) -> Sensor | None:
    key = _key(name)
    # Most files are named after their sensor, so that no other file must be read.
    for file in _files():
        if _key(file.removesuffix(".yaml")) == key and _key(_parsed(file).name) == key:
            return _parsed(file)
    return _index().get(key)


def _unknown(name: str) -> InputError:
    index = _index()
    near = difflib.get_close_matches(_key(name), index, n=8, cutoff=0.6)
    names = list(dict.fromkeys(index[match].name for match in near))[:4]
    return InputError(
        f"unknown sensor {name!r}",
        expected=f"one of {', '.join(names or sensor_names())}"
        + (" (`urbantwin catalogue sensors` lists them all)" if names else "")
        + ", or the path of a .yaml, .json or .csv file",
    )


@cache
def _catalogue(*below: str) -> tuple[Sensor, ...]:
    entries = [_parsed(*below, file) for file in _files(*below)]
    return tuple(sorted(entries, key=lambda entry: (entry.maker, _natural(entry.name))))


@cache
def _files(*below: str) -> tuple[str, ...]:
    folder = files(__package__).joinpath("sensors", *below)
    return tuple(entry.name for entry in folder.iterdir() if entry.name.endswith(".yaml"))


@cache
def _parsed(*path: str) -> Sensor:
    file = files(__package__).joinpath("sensors", *path)
    return parse_sensor(file.read_text(encoding="utf-8"), file.name)


@cache
def _index() -> dict[str, Sensor]:
    entries = (*_catalogue("nominal"), *_catalogue())
    index = {_key(alias): entry for entry in entries for alias in entry.aliases}
    return index | {_key(entry.name): entry for entry in entries}


def _key(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower())


def _natural(name: str) -> tuple[tuple[int, str], ...]:
    parts = re.findall(r"\d+|\D+", name)
    return tuple((int(part), "") if part.isdigit() else (-1, part) for part in parts)
