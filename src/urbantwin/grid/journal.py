"""Which cells of a grid are done, which failed, and how long they took."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from urbantwin.artefact.document import json_value, read_bytes
from urbantwin.errors import InputError, StageError

__all__ = ["ATTEMPTS", "Journal"]

#: A cell that fails is tried once more.
ATTEMPTS = 2
_EXPECTED = "a journal, or no file: then all begins anew"


class Journal:
    """A file beside the cells that says of each, by its key, what became of it.

    A key is a hash of all that the cell is made from (`dataset.manifest.recipe_key`): a cell of
    another grid that has the same key is the same cell. What is done stays done; what failed is
    tried again by the next run.

    Args:
        file: JSON lines, one more with every cell; of several about one cell the last counts. A
            last line that was cut off by the end of a run counts for nothing. It need not be there.

    Raises:
        InputError: the file is damaged.
    """

    def __init__(self, file: Path) -> None:
        self._file = file
        self._rows: dict[str, dict[str, Any]] = {}
        self._whole: int | None = None  # so many bytes are whole lines, where more are there
        if file.exists():
            self._read()

    def _read(self) -> None:
        data = read_bytes(self._file, _EXPECTED)
        whole = data.rfind(b"\n") + 1
        if whole < len(data):
            self._whole = whole
        for number, line in enumerate(data[:whole].splitlines(), start=1):
            row = json_value(line, file=self._file, expected=_EXPECTED)
            if not isinstance(row, dict) or not isinstance(row.get("cell"), str):
                raise InputError(
                    "is damaged", file=self._file, place=f"line {number}", expected=_EXPECTED
                )
            self._rows[row.pop("cell")] = row

    def row(self, key: str) -> dict[str, Any]:
        """Return what is noted of a cell; nothing of one that was never tried."""
        return self._rows.get(key, {})

    def is_done(self, key: str) -> bool:
        """Return whether a cell is done."""
        return self.row(key).get("state") == "done"

    def why(self, key: str) -> str | None:
        """Return why a cell failed, or ``None``."""
        row = self.row(key)
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
                self.note(key, state="failed", attempts=attempt, why=str(error))
                continue
            self.note(key, state="done", attempts=attempt, seconds=time.monotonic() - began)
            return True
        return False

    def forget(self, key: str) -> None:
        """Take a cell as if it was never done: what it left is gone."""
        self._rows.pop(key, None)

    def seconds_each(self) -> float | None:
        """Return how long a cell took on average, or ``None`` before the first."""
        took = [float(one["seconds"]) for one in self._rows.values() if "seconds" in one]
        return sum(took) / len(took) if took else None

    def note(self, key: str, /, **row: object) -> None:
        """Write down what became of a cell: ``state``, ``done`` or ``failed``, and what else."""
        self._rows[key] = row
        self._file.parent.mkdir(parents=True, exist_ok=True)
        if self._whole is not None:
            os.truncate(self._file, self._whole)
            self._whole = None
        line = json.dumps({"cell": key, **row}, ensure_ascii=False, allow_nan=False)
        with self._file.open("a", encoding="utf-8") as stream:
            stream.write(line + "\n")
