"""The cache of the arbitrary site's recordings."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from urbantwin import __version__
from urbantwin.artefact import claimed, remove_dead
from urbantwin.errors import InputError

__all__ = ["kept"]

#: So many recordings stay; of more, those that were made first go.
_MOST = 8
_MANIFEST = "dataset.json"


def kept(
    name: str,
    recipe: Mapping[str, Any],
    make: Callable[[Path], Path],
    scratch: Path,
    folder: Path | None = None,
) -> Path:
    """Return the dataset ``name`` that ``make`` made, now or when it was asked for before.

    It appears whole or not at all. Who asks while another process makes it makes its own.

    Args:
        name: of the folder that is returned.
        recipe: all that it follows from; our own code counts by itself.
        make: makes it in the folder that it is given, beside other things, and returns its folder.
        scratch: a folder, not there yet, to make it in where ``folder`` is not writable.
        folder: where such datasets are; the user's cache when not given.
    """
    text = json.dumps([__version__, _code(), name, recipe], sort_keys=True, default=str)
    key = hashlib.sha256(text.encode()).hexdigest()[:24]
    if folder is None:
        from platformdirs import user_cache_path

        folder = user_cache_path("urbantwin", appauthor=False) / "arbitrary"
    target = folder / key
    if (target / name / _MANIFEST).is_file():
        return target / name
    with ExitStack() as stack:
        try:
            made_in = stack.enter_context(claimed(target)).folder
        except InputError:  # Read-only, or another process is making it.
            scratch.mkdir()
            return make(scratch)
        dataset = make(made_in)
        for other in made_in.iterdir():
            if other != dataset:
                shutil.rmtree(other)
        dataset.rename(made_in / name)
        shutil.rmtree(target, ignore_errors=True)  # what is there is no dataset
        made_in.rename(target)
    _forget(folder, target)
    return target / name


def _forget(folder: Path, newest: Path) -> None:
    remove_dead(folder)
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
