"""The journal of trials on disk, from which an interrupted fit resumes."""

from __future__ import annotations

import json
from pathlib import Path
from types import TracebackType

from urbantwin.artefact.document import json_value
from urbantwin.errors import InputError

__all__ = ["Journal"]


class Journal:
    """Losses by study and trial, one line of JSON each.

    A study is deterministic, so that one that begins again asks for the same values in the same
    order; what is here need not be computed again. Lines of another recipe are dropped.

    Args:
        path: the file; made when the first trial is kept.
        recipe: what decides everything that is fitted.
    """

    def __init__(self, path: Path, recipe: str) -> None:
        self._path = path
        self._kept: dict[tuple[str, int], tuple[list[float], float]] = {}
        lines = (
            path.read_text(errors="replace", encoding="utf-8").splitlines()
            if path.is_file()
            else []
        )
        ours = bool(lines) and lines[0] == json.dumps({"recipe": recipe})
        for line in lines[1:] if ours else ():
            try:
                one = json_value(line, file=path, expected="a trial")
                key = (str(one["study"]), int(one["trial"]))
                self._kept[key] = ([float(x) for x in one["shares"]], float(one["loss"]))
            except (InputError, ValueError, KeyError, TypeError):
                break  # The line that was being written when it stopped.
        self._stream = path.open("w", encoding="utf-8")
        self._write({"recipe": recipe})
        for (study, trial), (shares, loss) in self._kept.items():
            self._write({"study": study, "trial": trial, "shares": shares, "loss": loss})

    def recall(self, study: str, trial: int, shares: list[float]) -> float | None:
        """Return the loss of a trial that was made before; ``None`` if it was not."""
        kept = self._kept.get((study, trial))
        return kept[1] if kept is not None and kept[0] == shares else None

    def keep(self, study: str, trial: int, shares: list[float], loss: float) -> None:
        """Keep the loss of a trial."""
        if (study, trial) not in self._kept:
            self._write({"study": study, "trial": trial, "shares": shares, "loss": loss})

    def _write(self, line: dict[str, object]) -> None:
        self._stream.write(json.dumps(line) + "\n")
        self._stream.flush()

    def __enter__(self) -> Journal:
        """Return the journal."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close it; without an error, the fit is there and it is taken away."""
        self._stream.close()
        if kind is None:
            self._path.unlink(missing_ok=True)
