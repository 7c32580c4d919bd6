"""Everything that UrbanTwin raises on purpose.

    UrbanTwinError
    ├── InputError      a file or value that a person gave is wrong      (exit code 2)
    │   └── TooLittleRoomError   the result will not fit on the disk
    └── StageError      a tool that a stage relies on failed             (exit code 1)
        ├── NoRoomError          the disk is full, or the quota used up
        └── LimitError           no memory, thread, process or open file is left

Only ``urbantwin.cli`` turns them into a line of text and an exit code.
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


class LimitError(StageError):
    """The system gives this process no more memory, threads, processes or open files."""


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
    """Return what is said of an error, and what to do, if a limit of the system is its cause.

    Libraries report it in many ways, and a reader of files may have taken it for a damaged file. A
    file that asks for more memory than this machine has is damaged all the same.

    Args:
        error: with what it was raised from, or while.

    Returns:
        The error to report instead; ``None`` where another cause is likelier.
    """
    cause: BaseException | None = error
    for _ in range(100):  # a chain may be a circle
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
        wanted = getattr(error, "_total_size", None)  # numpy's
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
    """Return a limit of this process; ``None`` where it has none (Windows knows no limits)."""
    try:
        import resource
    except ImportError:
        return None
    most = resource.getrlimit(getattr(resource, name))[0]
    return None if most == resource.RLIM_INFINITY else most


def _machine_bytes() -> int:
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
