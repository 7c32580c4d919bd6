"""All errors that UrbanTwin raises intentionally.

    UrbanTwinError
    ├── InputError      a file or value given by the user is wrong       (exit code 2)
    │   └── TooLittleRoomError   the result would not fit on the disk
    └── StageError      a tool used by a stage failed                    (exit code 1)
        ├── NoRoomError          the disk or the quota is full
        └── LimitError           a limit of memory, threads, processes or files

Only ``urbantwin.cli`` converts them to a line of text and an exit code.
"""

from __future__ import annotations

import errno
import os
import re
from pathlib import Path

__all__ = [
    "InputError",
    "LimitError",
    "NoRoomError",
    "StageError",
    "TooLittleRoomError",
    "UrbanTwinError",
    "limit_of_process",
    "limit_reached",
    "readable",
]

#: Most characters of each part of an error message; longer text is the content of a file.
_LONGEST = 320


def readable(text: str, most: int = _LONGEST) -> str:
    r"""Return a text as one printable line, shortened in the middle.

    Control characters (cursor, colour, writing direction), which may occur in names and values of
    any file, are escaped (``\x1b``).
    """
    if len(text) > 2 * most:  # cut first, to not process a million characters
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
    """Base class of all errors that UrbanTwin raises intentionally."""

    def __str__(self) -> str:
        """Return the error as one line."""
        return readable(super().__str__(), 3 * _LONGEST)


class InputError(UrbanTwinError):
    """A file or a value given by the user is wrong.

    ``str(error)`` is one line: ``FILE: PLACE: problem; expected value``. Long parts are shortened.

    Args:
        problem: description of the error.
        file: file with the wrong value, if any.
        place: place in the file: a field (``traffic.per_hour.car``), a line, an element's id.
        expected: description of a valid value.
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
        """Make the error picklable, for worker processes."""
        return (_input_error, self.args)

    def __str__(self) -> str:
        """Return the error as one line."""
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
    """A tool used by a stage (netconvert, SUMO) failed on input that passed our checks."""


class TooLittleRoomError(InputError):
    """The result would not fit on the disk; nothing was written."""


class NoRoomError(StageError):
    """The disk is full, or cannot be written to any more; further steps would fail as well."""


class LimitError(StageError):
    """The system denies this process more memory, threads, processes or open files."""


_NO_MEMORY = re.compile(
    "out of memory|cannot allocate memory|unable to allocate|no memory|bad_alloc|malloc of size",
    re.IGNORECASE,
)
_NO_THREAD = re.compile(
    "start new thread|launch worker thread|resource temporarily unavailable|pthread_create",
    re.IGNORECASE,
)
_NO_FILE = re.compile("too many open files", re.IGNORECASE)


def limit_reached(error: BaseException) -> LimitError | None:
    """Return an error with a remedy, if a system limit caused the given error.

    Libraries report limits in many ways, and a reader may have reported a damaged file instead. A
    file that requests more memory than the machine has counts as damaged.

    Args:
        error: the error; its causes and contexts are examined as well.

    Returns:
        The error to report instead; ``None`` if another cause is more likely.
    """
    cause: BaseException | None = error
    for _ in range(100):  # the chain may be circular
        if cause is None:
            return None
        if isinstance(cause, LimitError):
            return cause
        told = _limit_of(cause)
        if told is not None:
            return LimitError(told)
        cause = cause.__cause__ or cause.__context__
    return None


def _limit_of(error: BaseException) -> str | None:
    number = error.errno if isinstance(error, OSError) else None
    said = "" if isinstance(error, InputError) else str(error)
    if number in (errno.EMFILE, errno.ENFILE) or _NO_FILE.search(said):
        return (
            f"too many files are open: this process may open {limit_of_process('RLIMIT_NOFILE')}; "
            "allow more (ulimit -n 1024) and give the same command again"
        )
    if number == errno.EAGAIN or (not isinstance(error, MemoryError) and _NO_THREAD.search(said)):
        return (
            "the system gives this process no more threads or processes; use fewer (--workers 1), "
            "or allow more (ulimit -u, ulimit -v, the container's limits)"
        )
    if isinstance(error, MemoryError):
        wanted = getattr(error, "_total_size", None)  # attribute of NumPy's error
        if isinstance(wanted, int) and wanted > _machine_bytes():
            return None
    elif number != errno.ENOMEM and not _NO_MEMORY.search(said):
        return None
    most = limit_of_process("RLIMIT_AS")
    limited = "" if most is None else (
        f": this process may use {most / 1e9:.1f} GB of addresses (ulimit -v)"
    )  # fmt: skip
    return (
        f"out of memory{limited}; use fewer processes (--workers 1), a smaller region or fewer "
        "points, or allow more memory"
    )


def limit_of_process(name: str) -> int | None:
    """Return a limit of this process; ``None`` if unlimited or on Windows."""
    try:
        import resource
    except ImportError:
        return None
    most = resource.getrlimit(getattr(resource, name))[0]
    return None if most == resource.RLIM_INFINITY else most


def _machine_bytes() -> int:
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
