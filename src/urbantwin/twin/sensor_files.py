"""Copies of a rig's sensor files in the twin."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import yaml

from urbantwin.site.rig import RigSpec

__all__ = ["copy_sensor_files", "pattern_beside", "sensor_file"]

_FILE_SUFFIXES = (".yaml", ".yml", ".json", ".csv")


def copy_sensor_files(spec: RigSpec, rig_file: Path, folder: Path) -> dict[str, Any]:
    """Copy the files of a rig's sensor models, and return the rig with their new names.

    Args:
        spec: the rig.
        rig_file: file of the rig; its sensor files are beside it or in the current folder.
        folder: target folder; files are named ``NAME.sensor.ENDING``.

    Returns:
        The rig's values; names of missing files are unchanged.
    """
    rig = spec.written()
    new_names: dict[Path, str] = {}
    for sensor in rig["sensors"]:
        model, path = sensor_file(sensor["model"], rig_file.parent)
        if path is None:
            continue
        path = path.resolve()
        if path not in new_names:
            name, number = f"{path.stem}.sensor{path.suffix}", 2
            while name in new_names.values():
                name, number = f"{path.stem}.{number}.sensor{path.suffix}", number + 1
            new_names[path] = name
            _copy_with_pattern(path, folder / name)
        sensor["model"] = f"{model}{new_names[path]}"
    return rig


def sensor_file(model: str, folder: Path) -> tuple[str, Path | None]:
    """Return the prefix and the file of a sensor's model.

    Args:
        model: a name of the catalogue, ``PATH``, or ``MODEL:PATH``.
        folder: folder of the rig's file; files may also be in the current folder.

    Returns:
        ``MODEL:`` or an empty text, and the path; ``None`` if there is no such file.
    """
    # A single letter before a colon is a drive.
    before, colon, path = model.partition(":")
    if len(before) == 1 or not colon or "/" in before:
        before, colon, path = "", "", model
    if not path.lower().endswith(_FILE_SUFFIXES):
        return "", None
    file = next(
        (candidate for candidate in (folder / path, Path(path)) if candidate.is_file()), None
    )
    return before + colon, file


def pattern_beside(path: Path) -> Path | None:
    """Return the scan pattern that a sensor's YAML file names, if it exists."""
    named = _read(path).get("pattern")
    if not isinstance(named, str) or not (path.parent / named).is_file():
        return None
    return path.parent / named


def _copy_with_pattern(source: Path, target: Path) -> None:
    """Copy a sensor's file, with the scan pattern that a YAML file names."""
    shutil.copyfile(source, target)
    named = pattern_beside(source)
    if named is None:
        return
    pattern = target.with_name(f"{target.stem}.pattern{named.suffix}")
    shutil.copyfile(named, pattern)
    target.write_text(
        yaml.safe_dump({**_read(source), "pattern": pattern.name}, sort_keys=False),
        encoding="utf-8",
    )


def _read(path: Path) -> dict[str, Any]:
    """Return the content of a sensor's YAML file; empty for another or a damaged file."""
    if path.suffix.lower() not in (".yaml", ".yml"):
        return {}
    try:
        value = yaml.safe_load(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError, yaml.YAMLError):
        return {}  # Reported by the reader of the sensor.
    return value if isinstance(value, dict) else {}
