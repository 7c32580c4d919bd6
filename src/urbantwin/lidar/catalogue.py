"""The sensor catalogue: one YAML file per sensor, read into a ``Sensor``.

The catalogue's files stand in ``urbantwin/lidar/sensors``. Every number in them names its source,
and what is not known is ``null`` with the reason: nothing is guessed in a file. A person's own
file works wherever a model's name does: YAML of the same form, the metadata of an Ouster sensor
(JSON), or the angle correction of a Hesai sensor (CSV).
"""

from __future__ import annotations

import difflib
import re
from functools import cache
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path

from urbantwin.errors import InputError
from urbantwin.lidar.sensor import Sensor
from urbantwin.lidar.sensor_file import parse_sensor, read_text

__all__ = ["Sensor", "load_sensor", "sensor", "sensor_names"]

_YAML = (".yaml", ".yml")


def sensor_names() -> tuple[str, ...]:
    """Return the names of the catalogue's sensors, by maker and then by name."""
    return tuple(entry.name for entry in _catalogue())


def sensor(name: str | Path) -> Sensor:
    """Return the sensor of that name, or of a person's own file.

    Case, dashes, underscores, dots and blanks do not matter: ``os1 128`` is ``OS1-128``.

    Args:
        name: a name or alias of the catalogue, or the path of a file that `load_sensor` reads.

    Raises:
        InputError: no sensor has that name (the error lists the nearest), or the file is wrong.
    """
    if str(name).lower().endswith(_YAML):
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
    return parse_sensor(read_text(path, "a sensor's YAML file"), path)


@cache
def _catalogue() -> tuple[Sensor, ...]:
    def is_sensor(entry: Traversable) -> bool:
        return entry.name.endswith(".yaml")

    folder = files(__package__).joinpath("sensors")
    entries = [parse_sensor(e.read_text(), e.name) for e in folder.iterdir() if is_sensor(e)]
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
