"""Disk space: checked before long work, and the error when it runs out."""

from __future__ import annotations

import errno
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from urbantwin.errors import InputError, NoRoomError, TooLittleRoomError

__all__ = ["check_room", "says_no_room", "told_size"]

_FULL = {
    errno.ENOSPC: "there is no room left on its disk",
    errno.EDQUOT: "the quota of its disk is used up",
    errno.EFBIG: "files may not be so large here (ulimit -f)",
}
#: NumPy's message for a partly written array.
_CUT = re.compile(r"\d+ requested and \d+ written")
#: Free space below which an unexplained failure is attributed to a full disk, bytes.
_NOTHING = 1 << 16


def check_room(folder: Path, needed: float, what: str) -> None:
    """Check that a result will fit on the disk.

    Args:
        folder: folder of the result, which may not exist yet.
        needed: lower estimate of its size, bytes.
        what: name of the result, for the message.

    Raises:
        TooLittleRoomError: less space is free.
    """
    there = next(one for one in (folder, *folder.absolute().parents) if one.is_dir())
    free = shutil.disk_usage(there).free
    if needed > free:
        raise TooLittleRoomError(
            f"{what} needs about {told_size(needed)}, and {told_size(free)} are free on the disk",
            file=folder,
            expected="more room, another disk, or less to write",
        )


@contextmanager
def says_no_room(target: Path, scratch: Path, *, goes_on: bool = False) -> Iterator[None]:
    """Convert errors caused by a full disk into one line with a remedy.

    Libraries and programs report a full disk in many ways, or only fail.

    Args:
        target: the output.
        scratch: folder where it is written.
        goes_on: whether partial output is kept.

    Raises:
        NoRoomError: the disk is full; replaces the block's error.
    """
    try:
        yield
    except Exception as error:
        why, file = _reason(error, scratch)
        if why is None:
            raise
        then = "make room and give the same command again"
        if goes_on:
            then += ": it goes on from what was made"
        name = target if file is None else target / _within(file, scratch)
        raise NoRoomError(f"{name}: {why}; {then}") from error


def _reason(error: BaseException, scratch: Path) -> tuple[str | None, str | None]:
    """Return why there is no space, and the affected file, if that caused the error."""
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, OSError) and cause.errno in _FULL:
            return _FULL[cause.errno], cause.filename
        cause = cause.__cause__ or cause.__context__
    if isinstance(error, InputError) and not (error.file and _is_in(error.file, scratch)):
        return None, None  # an error in the user's input is unrelated
    said = str(error)
    for number, why in _FULL.items():
        if f"Errno {number}]" in said or (number == errno.EFBIG and "SIGXFSZ" in said):
            return why, None
    if _CUT.search(said):
        import resource  # not on Windows, where nothing is written

        limited = resource.getrlimit(resource.RLIMIT_FSIZE)[0] != resource.RLIM_INFINITY
        return _FULL[errno.EFBIG if limited else errno.ENOSPC], None
    if scratch.exists() and shutil.disk_usage(scratch).free < _NOTHING:
        return _FULL[errno.ENOSPC], None
    return None, None


def _is_in(file: str, scratch: Path) -> bool:
    return Path(file).is_relative_to(scratch)


def _within(file: str, scratch: Path) -> str:
    path = Path(str(file))
    return str(path.relative_to(scratch)) if _is_in(file, scratch) else path.name


def told_size(size: float) -> str:
    """Return a size in bytes as text: ``2.36 MB``."""
    for unit in ("B", "kB", "MB", "GB"):
        if size < 1000:
            return f"{size:.3g} {unit}"
        size /= 1000
    return f"{size:.3g} TB"
