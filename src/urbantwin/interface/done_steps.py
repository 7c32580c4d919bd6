"""Steps of a long command that are done, so that the same command goes on from there."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

__all__ = ["DoneSteps"]


class DoneSteps:
    """Which steps are done, and of what: a step is done again only if what it is of changed.

    Args:
        file: keeps it, JSON.
    """

    def __init__(self, file: Path) -> None:
        from urbantwin.artefact.document import read_json_value

        file.parent.mkdir(parents=True, exist_ok=True)
        self._file = file
        known = read_json_value(file, "a list of steps") if file.is_file() else {}
        self._done: dict[str, str] = known if isinstance(known, dict) else {}

    def once(
        self, name: str, asked: Mapping[str, Any], folder: Path, make: Callable[[Path], object]
    ) -> str:
        """Do a step unless its folder is there and of the same; return what it is of."""
        from urbantwin.artefact import write_json
        from urbantwin.dataset.manifest import recipe_key

        key = recipe_key({"step": name, **asked})
        if self._done.get(name) != key or not folder.is_dir():
            make(folder)
            self._done[name] = key
            write_json(self._file, self._done)
        return key
