"""Where the recordings of the arbitrary site are kept, so that the next comparison finds them."""

from __future__ import annotations

import hashlib
import json
import shutil
import tempfile
import weakref
from collections.abc import Callable, Mapping
from contextlib import suppress
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from urbantwin import __version__

__all__ = ["kept"]

#: So many recordings stay; of more, those that were made first go.
_MOST = 8
_MANIFEST = "dataset.json"


def kept(
    name: str,
    recipe: Mapping[str, Any],
    make: Callable[[Path], None],
    folder: Path | None = None,
) -> tuple[Path, object]:
    """Return the folder ``name`` that ``make`` wrote, now or when it was asked for before.

    It appears whole or not at all, whoever makes it at the same time.

    Args:
        name: of the folder that is returned.
        recipe: all that it follows from; our own code counts by itself.
        make: writes the folder that it is given, which does not exist yet.
        folder: where such folders are; the user's cache when not given. Where nobody can write
            there, the folder lasts as long as what is returned beside it.
    """
    text = json.dumps([__version__, _code(), name, recipe], sort_keys=True, default=str)
    key = hashlib.sha256(text.encode()).hexdigest()[:24]
    if folder is None:
        from platformdirs import user_cache_path

        folder = user_cache_path("urbantwin", appauthor=False) / "arbitrary"
    target = folder / key
    if not (target / name / _MANIFEST).is_file():
        try:
            folder.mkdir(parents=True, exist_ok=True)
            scratch = tempfile.TemporaryDirectory(prefix=".making-", dir=folder)
        except OSError:
            passing = _Passing()
            make(passing.folder / name)
            return passing.folder / name, passing
        with scratch:
            made = Path(scratch.name) / key
            made.mkdir()
            make(made / name)
            with suppress(OSError):  # Somebody else was faster: theirs is the same.
                made.rename(target)
        _forget(folder, target)
    return target / name, None


class _Passing:
    """A folder that is there as long as this object is."""

    def __init__(self) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="urbantwin-"))
        weakref.finalize(self, shutil.rmtree, self.folder, ignore_errors=True)


def _forget(folder: Path, newest: Path) -> None:
    there = [one for one in folder.iterdir() if one.is_dir() and not one.name.startswith(".")]
    older = sorted((one for one in there if one != newest), key=lambda one: one.stat().st_mtime)
    for one in older[: max(len(older) - _MOST + 1, 0)]:
        shutil.rmtree(one, ignore_errors=True)


def _code() -> str:
    """Return the SHA-256 of the package's own files: between two versions code changes too."""
    digest = hashlib.sha256()

    def add(folder: Traversable) -> None:
        for entry in sorted(folder.iterdir(), key=lambda one: one.name):
            if entry.is_dir():
                add(entry)
            elif entry.name.endswith((".py", ".yaml", ".csv")):
                digest.update(entry.read_bytes())

    for floor in ("geometry", "site", "ground", "roads", "scene", "twin", "traffic", "lidar"):
        add(files("urbantwin").joinpath(floor))
    add(files("urbantwin").joinpath("dataset"))
    return digest.hexdigest()
