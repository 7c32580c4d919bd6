"""Everything that UrbanTwin raises on purpose.

    UrbanTwinError
    ├── InputError      a file or value that a person gave is wrong      (exit code 2)
    │   └── TooLittleRoomError   the result will not fit on the disk
    └── StageError      a tool that a stage relies on failed             (exit code 1)
        └── NoRoomError          the disk is full, or the quota used up

Only ``urbantwin.cli`` turns them into a line of text and an exit code.
"""

from __future__ import annotations

from pathlib import Path

__all__ = [
    "InputError",
    "NoRoomError",
    "StageError",
    "TooLittleRoomError",
    "UrbanTwinError",
    "readable",
]

#: Most characters of each part of an error: what is longer is a file's content, not a message.
_LONGEST = 320


def readable(text: str, most: int = _LONGEST) -> str:
    r"""Return a text as one line that a terminal shows as it is, shortened in its middle.

    Bytes that move the cursor, change colours or turn the direction of writing come as escapes
    (``\x1b``): they may stand in the names and values of any file.
    """
    if len(text) > 2 * most:  # the middle goes before each of a million letters is looked at
        text = f"{text[:most]} ... {text[-most:]}"
    line = " ".join(text.split())
    if not line.isprintable():
        line = "".join(
            letter if letter.isprintable() else letter.encode("unicode_escape").decode()
            for letter in line
        )
    if len(line) <= most:
        return line
    begin = (most - 5) * 2 // 3
    return f"{line[:begin]} ... {line[begin + 5 - most :]}"


class UrbanTwinError(Exception):
    """The common root: catch it to catch every error that UrbanTwin raises on purpose."""

    def __str__(self) -> str:
        """Return the one line that a person reads."""
        return readable(super().__str__(), 3 * _LONGEST)


class InputError(UrbanTwinError):
    """A file or a value that a person gave is wrong.

    ``str(error)`` is one line: ``FILE: PLACE: what is wrong; expected what was expected``, in which
    each part is shortened where it is longer than a line or two.

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
        parts = (self.file, self.place, self.problem)
        text = ": ".join(readable(part) for part in parts if part)
        if self.expected:
            text += f"; expected {readable(self.expected)}"
        return text


def _input_error(
    problem: str, file: str | None, place: str | None, expected: str | None
) -> InputError:
    return InputError(problem, file=file, place=place, expected=expected)


class StageError(UrbanTwinError):
    """A tool that a stage relies on (netconvert, SUMO) failed on input that passed our checks."""


class TooLittleRoomError(InputError):
    """What is asked for will not fit on the disk; nothing was begun."""


class NoRoomError(StageError):
    """The disk is full, or may not be written to any further; whatever comes next fails, too."""
