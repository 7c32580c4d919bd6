"""Runs of SUMO that only look on: what one showed is kept in the user's cache.

How many a street carries takes pilots of 25 minutes. Whoever drives a twin again with its seed, for
longer, with an event or beside a variant, has them already: the same input gives the same answer.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import Any

from platformdirs import user_cache_path

__all__ = ["FILES", "kept_run"]

#: What a run leaves.
FILES = ("rows.npy", "outcome.json")
#: So many runs stay, of some 10 kB each; of more, those that were used first go.
_MOST = 500
#: What was not moved to its place for so long was left, seconds.
_LEFT_S = 3600.0


def kept_run(
    recipe: Mapping[str, Any],
    inputs: Sequence[Path],
    make: Callable[[], None],
    made: Path,
    cache: Path | None = None,
) -> None:
    """Put what a run leaves (`FILES`) into a folder: from the cache, or by running it.

    Args:
        recipe: all that the run follows from but its files; SUMO and our own code are counted in.
        inputs: the files that it reads.
        make: runs it, which leaves the files in ``made``.
        made: where the files are to be.
        cache: where runs are kept; the user's cache when not given.
    """
    folder = cache or user_cache_path("urbantwin", appauthor=False) / "sumo"
    run = folder / _key(recipe, inputs)
    with suppress(OSError):
        for name in FILES:
            shutil.copyfile(run / name, made / name)
        os.utime(run)
        return
    make()
    with suppress(OSError):  # a cache that cannot be written is none
        folder.mkdir(parents=True, exist_ok=True)
        new = Path(tempfile.mkdtemp(prefix=".", dir=folder))
        try:
            for name in FILES:
                shutil.copyfile(made / name, new / name)
            shutil.rmtree(run, ignore_errors=True)  # of which a file is lost
            new.rename(run)
        finally:
            shutil.rmtree(new, ignore_errors=True)
        _forget(folder)


def _key(recipe: Mapping[str, Any], inputs: Sequence[Path]) -> str:
    digest = hashlib.sha256(version("libsumo").encode())
    digest.update(json.dumps(recipe, sort_keys=True, default=str).encode())
    for path in (*sorted(Path(__file__).parent.glob("*.py")), *inputs):
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()[:32]


def _forget(folder: Path) -> None:
    """Remove the runs that were used longest ago, and what killed programs left half written."""
    for one in folder.glob(".*"):
        with suppress(OSError):
            if time.time() - one.stat().st_mtime > _LEFT_S:
                shutil.rmtree(one, ignore_errors=True)
    runs = [one for one in folder.iterdir() if not one.name.startswith(".")]
    if len(runs) > _MOST:
        for one in sorted(runs, key=lambda run: run.stat().st_mtime)[: len(runs) - _MOST]:
            shutil.rmtree(one, ignore_errors=True)
