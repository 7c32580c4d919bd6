"""Everything that UrbanTwin raises on purpose.

    UrbanTwinError
    ├── InputError      a file or value that a person gave is wrong      (exit code 2)
    └── StageError      a tool that a stage relies on failed             (exit code 1)

Only ``urbantwin.cli`` turns them into a line of text and an exit code.
"""

from __future__ import annotations

from pathlib import Path

__all__ = ["InputError", "StageError", "UrbanTwinError"]


class UrbanTwinError(Exception):
    """The common root: catch it to catch every error that UrbanTwin raises on purpose."""


class InputError(UrbanTwinError):
    """A file or a value that a person gave is wrong.

    ``str(error)`` is one line: ``FILE: PLACE: what is wrong; expected what was expected``.

    Args:
        problem: what is wrong, in the reader's words.
        file: the file that holds the bad value, if there is one.
        place: where in that file: a field (``traffic.per_hour.car``), a line, an element's id.
        expected: what would have been right.
    """

    def __init__(
        self,
        problem: str,
        *,
        file: str | Path | None = None,
        place: str | None = None,
        expected: str | None = None,
    ) -> None:
        self.problem = problem
        self.file = None if file is None else str(file)
        self.place = place
        self.expected = expected
        super().__init__(problem, self.file, place, expected)

    def __reduce__(self) -> tuple[object, ...]:
        """Let the error travel from a worker process to the one that tells it."""
        return (_input_error, self.args)

    def __str__(self) -> str:
        """Return the one line that a person reads."""
        text = ": ".join(part for part in (self.file, self.place, self.problem) if part)
        if self.expected:
            text += f"; expected {self.expected}"
        return " ".join(text.split())


def _input_error(
    problem: str, file: str | None, place: str | None, expected: str | None
) -> InputError:
    return InputError(problem, file=file, place=place, expected=expected)


class StageError(UrbanTwinError):
    """A tool that a stage relies on (netconvert, SUMO) failed on input that passed our checks."""
