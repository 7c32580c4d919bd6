"""Which steps of an experiment are done: known by their place and by a hash of their inputs."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from urbantwin import __version__
from urbantwin.artefact.document import json_value, read_bytes
from urbantwin.errors import InputError, StageError

__all__ = ["ATTEMPTS", "JOURNAL", "Journal", "step_key"]

#: File of the journal in the folder of an experiment.
JOURNAL = "journal/steps.jsonl"
#: Number of attempts of a step that fails.
ATTEMPTS = 2
_EXPECTED = "a journal, or no file: then all begins anew"


def step_key(made_from: Mapping[str, Any]) -> str:
    """Return the key of a step: a hash of its inputs and of the versions of the software."""
    from urbantwin.dataset.manifest import recipe_key

    return recipe_key({"made_by": _versions(), **made_from})


@cache
def _versions() -> str:
    from urbantwin.dataset.manifest import recipe_key, versions_here

    return recipe_key({"urbantwin": __version__, **versions_here()})


class Journal:
    """The journal of an experiment, as JSON lines; a line is added whenever a step ends.

    A step has a place, which is its folder or file within the experiment's folder, and a key
    (`step_key`). It is done if the last line about its place has the state ``done`` and the same
    key, and if its output exists. Therefore an added level creates only the new cells, and a
    changed input recreates the steps that depend on it.

    Args:
        folder: folder of the experiment.
        file: name of the journal in the folder; the file need not exist. A last line that is
            incomplete because a run was interrupted is ignored.

    Raises:
        InputError: the file is damaged.
    """

    def __init__(self, folder: Path, file: str = JOURNAL) -> None:
        self.folder = folder
        self._file = folder / file
        self._rows: dict[str, dict[str, Any]] = {}
        self._whole_bytes: int | None = None  # bytes before an incomplete line
        if self._file.exists():
            self._read()

    def _read(self) -> None:
        data = read_bytes(self._file, _EXPECTED)
        whole = data.rfind(b"\n") + 1
        if whole < len(data):
            self._whole_bytes = whole
        for number, line in enumerate(data[:whole].splitlines(), start=1):
            row = json_value(line, file=self._file, expected=_EXPECTED)
            if not isinstance(row, dict) or not isinstance(row.get("cell"), str):
                raise InputError(
                    "is damaged", file=self._file, place=f"line {number}", expected=_EXPECTED
                )
            self._rows[row.pop("cell")] = row

    def row(self, place: str) -> dict[str, Any]:
        """Return the last journal row of a step; empty if the step was never run."""
        return self._rows.get(place, {})

    def is_done(self, place: str, key: str, output: str = "") -> bool:
        """Return whether a step is done with a key; ``output`` is a file in its folder."""
        row = self.row(place)
        done = row.get("state") == "done" and row.get("key") == key
        return done and (self.folder / place / output).exists()

    def once(
        self, place: str, key: str, make: Callable[[Path], object], *, attempts: int = 1
    ) -> bool:
        """Create a step at its place unless it is done; return whether it was created now.

        Args:
            place: place of the step.
            key: key of the step.
            make: creates the step; called with its folder or file.
            attempts: maximum number of attempts.

        Raises:
            InputError: an input is wrong; another attempt would not help.
            StageError: the last attempt failed.
        """
        if self.is_done(place, key):
            return False
        for attempt in range(1, attempts + 1):
            began = time.monotonic()
            try:
                make(self.folder / place)
            except StageError as error:
                self.note(place, state="failed", key=key, attempts=attempt, why=str(error))
                if attempt == attempts:
                    raise
                continue
            seconds = round(time.monotonic() - began, 3)
            self.note(place, state="done", key=key, attempts=attempt, seconds=seconds)
            break
        return True

    def note(self, place: str, /, **row: object) -> None:
        """Record the result of a step: ``state`` (``done`` or ``failed``) and other values."""
        self._rows[place] = row
        self._file.parent.mkdir(parents=True, exist_ok=True)
        if self._whole_bytes is not None:
            os.truncate(self._file, self._whole_bytes)
            self._whole_bytes = None
        line = json.dumps({"cell": place, **row}, ensure_ascii=False, allow_nan=False)
        with self._file.open("a", encoding="utf-8") as stream:
            stream.write(line + "\n")
