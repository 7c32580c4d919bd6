"""The files that a rig's sensors are described by, kept in the twin so that it stays whole."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import yaml

from urbantwin.site.rig import RigSpec

__all__ = ["kept_rig"]

_FILES = (".yaml", ".yml", ".json", ".csv")


def kept_rig(spec: RigSpec, rig_file: Path, folder: Path) -> dict[str, Any]:
    """Copy the files that a rig names as its sensors' models, and return the rig that names them.

    Args:
        spec: the rig.
        rig_file: where it was written; its files stand beside it or in the current folder.
        folder: where they go, as ``NAME.sensor.ENDING``.

    Returns:
        The rig's values; a file that is not there is named as it was.
    """
    rig = spec.written()
    kept: dict[Path, str] = {}
    for one in rig["sensors"]:
        # A Hesai file may have its model before it, ``MODEL:PATH``; one letter is a drive.
        model, colon, path = one["model"].partition(":")
        if len(model) == 1 or not colon or "/" in model:
            model, colon, path = "", "", one["model"]
        if not path.lower().endswith(_FILES):
            continue
        found = next((p for p in (rig_file.parent / path, Path(path)) if p.is_file()), None)
        if found is None:
            continue
        found = found.resolve()
        if found not in kept:
            name, number = f"{found.stem}.sensor{found.suffix}", 2
            while name in kept.values():
                name, number = f"{found.stem}.{number}.sensor{found.suffix}", number + 1
            kept[found] = name
            _keep(found, folder / name)
        one["model"] = f"{model}{colon}{kept[found]}"
    return rig


def _keep(source: Path, target: Path) -> None:
    """Copy a sensor's file; the scan pattern that a YAML file names comes with it."""
    shutil.copyfile(source, target)
    if source.suffix.lower() not in (".yaml", ".yml"):
        return
    try:
        value = yaml.safe_load(source.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError, yaml.YAMLError):
        return  # Whoever reads the sensor says what is wrong with it.
    named = value.get("pattern") if isinstance(value, dict) else None
    if not isinstance(named, str) or not (source.parent / named).is_file():
        return
    pattern = target.with_name(f"{target.stem}.pattern{Path(named).suffix}")
    shutil.copyfile(source.parent / named, pattern)
    target.write_text(yaml.safe_dump({**value, "pattern": pattern.name}, sort_keys=False))
