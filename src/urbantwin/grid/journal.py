"""Which cells of a grid are done, which failed, and how long they took."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from urbantwin.artefact import read_json, write_json
from urbantwin.errors import InputError, StageError

__all__ = ["Journal"]

#: A cell that fails is tried once more.
ATTEMPTS = 2


class Journal:
    """A file beside the cells that says of each, by its key, what became of it.

    A key is a hash of all that the cell is made from (`dataset.manifest.recipe_key`): a cell of
    another grid that has the same key is the same cell. What is done stays done; what failed is
    tried again by the next run.

    Args:
        file: JSON, written anew after every cell; it need not be there.

    Raises:
        InputError: the file is damaged.
    """

    def __init__(self, file: Path) -> None:
        self._file = file
        self._rows: dict[str, dict[str, Any]] = {}
        if file.is_file():
            rows = read_json(file, kind="journal").get("cells")
            if not isinstance(rows, dict) or not all(isinstance(x, dict) for x in rows.values()):
                raise InputError(
                    "is damaged", file=file, expected="a journal, or no file: then all begins anew"
                )
            self._rows = rows

    def is_done(self, key: str) -> bool:
        """Return whether a cell is done."""
        return self._rows.get(key, {}).get("state") == "done"

    def why(self, key: str) -> str | None:
        """Return why a cell failed, or ``None``."""
        row = self._rows.get(key, {})
        return str(row.get("why")) if row.get("state") == "failed" else None

    def once(self, key: str, make: Callable[[], object]) -> bool:
        """Do a cell unless it is done, once more if it fails; return whether it is done.

        Raises:
            InputError: something given is wrong, which trying again does not change.
        """
        if self.is_done(key):
            return True
        for attempt in range(1, ATTEMPTS + 1):
            began = time.monotonic()
            try:
                make()
            except StageError as error:
                self._note(key, state="failed", attempts=attempt, why=str(error))
                continue
            self._note(key, state="done", attempts=attempt, seconds=time.monotonic() - began)
            return True
        return False

    def forget(self, key: str) -> None:
        """Take a cell as if it was never done: what it left is gone."""
        self._rows.pop(key, None)

    def seconds_each(self) -> float | None:
        """Return how long a cell took on average, or ``None`` before the first."""
        took = [float(one["seconds"]) for one in self._rows.values() if "seconds" in one]
        return sum(took) / len(took) if took else None

    def _note(self, key: str, **row: object) -> None:
        self._rows[key] = row
        write_json(self._file, {"kind": "journal", "cells": dict(sorted(self._rows.items()))})
