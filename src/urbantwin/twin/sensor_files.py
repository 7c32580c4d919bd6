"""The files that a rig's sensors are described by, kept in the twin so that it stays whole."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

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
    rig = spec.model_dump()
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
            shutil.copyfile(found, folder / name)
        one["model"] = f"{model}{colon}{kept[found]}"
    return rig
