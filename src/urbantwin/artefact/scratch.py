"""Scratch beside an output: a hidden folder with its owner's process in its name, and a lock.

``.NAME.PROCESS.urbantwin-new`` holds the output of a running process,
``.NAME.PROCESS.KEY.urbantwin-partial`` a state that a later run can resume, and
``.NAME.PROCESS.urbantwin-old`` an output that has just been replaced. A run holds a lock
(``flock``) on its own folder; the kernel releases the lock when the process dies, so nothing stays
locked, and the next run on the same output recognises dead scratch and removes it. Windows lacks
such locks, so writing is not supported there.
"""

from __future__ import annotations

import ctypes
import errno
import hashlib
import importlib.util
import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import count
from pathlib import Path

from urbantwin.errors import InputError
from urbantwin.interruption import deferred

__all__ = [
    "Scratch",
    "alone",
    "claimed",
    "inside_scratch",
    "new_folder",
    "passing_folder",
    "put_in_place",
    "refuse_if_written",
    "remove_dead",
]

_NEW, _PARTIAL, _OLD = ".urbantwin-new", ".urbantwin-partial", ".urbantwin-old"
_LEFT = re.compile(
    rf"\.(?P<name>.+)\.(?P<process>\d+)(?:\.(?P<key>[0-9a-f]{{16}}){_PARTIAL}|{_NEW}|{_OLD})"
)
#: Longest part of an output's name in a scratch name, which file systems limit.
_LONGEST = 150
_NO_LOCKS = (errno.EBADF, errno.EINVAL, errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP)
_EXCHANGE = 2  # RENAME_EXCHANGE, renameat2(2)
_HERE = -100  # AT_FDCWD
_held: set[tuple[int, int]] = set()
_numbers = count()


@dataclass(frozen=True)
class Scratch:
    """Scratch of a run.

    Attributes:
        target: the output, without symbolic links.
        folder: the scratch folder; empty, or the state of an interrupted run with the same key.
    """

    target: Path
    folder: Path


@contextmanager
def claimed(target: Path, *, key: str | None = None) -> Iterator[Scratch]:
    """Hold an output: yield scratch for it, while no other run may write it.

    Scratch of dead runs is removed before, and this scratch at the end. With a ``key`` it is kept
    when the block fails, for the next run with that key, until a run on this output succeeds.

    Args:
        target: the output; its parent folder is created if missing, and removed again if the block
            fails and leaves it empty.
        key: 16 hexadecimal digits that identify the result.

    Raises:
        InputError: another run is writing it, it is not writable, or this is Windows.
    """
    target = Path(os.path.realpath(target))
    _refuse_windows(target)
    lock: int | None = None
    folder: Path | None = None
    with new_folder(target.parent):
        try:
            try:
                with alone(target.parent):
                    refuse_if_written(target)
                    _clear(target)
                    with deferred():
                        folder = _own(target, key)
                        lock = _lock(folder)
            except OSError as error:
                raise _not_writable(target, error) from None
            yield Scratch(target, folder)
        except BaseException:
            with deferred():
                if folder and (key is None or not any(one.is_file() for one in folder.rglob("*"))):
                    _remove(folder)
                _close(lock)
            raise
        with deferred():
            _remove(folder)
            _close(lock)
            remove_dead(target.parent, target.name)


def refuse_if_written(target: Path) -> None:
    """Raise an error if a run is currently writing an output.

    Args:
        target: the output, without symbolic links.

    Raises:
        InputError: a run is writing it, or this is Windows.
    """
    _refuse_windows(target)
    for left, process, _ in _left(target):
        if not _is_dead(left, process):
            raise InputError(
                f"another run is writing it (process {process})",
                file=target,
                expected="another output, or to wait for that run",
            )


@contextmanager
def new_folder(folder: Path) -> Iterator[None]:
    """Create a folder to write to; remove it again if the block leaves it empty.

    Raises:
        InputError: the folder cannot be created.
    """
    made: list[Path] = []
    try:
        with deferred():  # all created folders are recorded
            made += _make_parents(folder)
        yield
    finally:
        for one in made:
            with suppress(OSError):  # Something is in it.
                one.rmdir()


@contextmanager
def passing_folder(subject: str) -> Iterator[Path]:
    """Yield a temporary folder that is removed with the block.

    Folders left by killed runs with the same subject are removed as well.
    """
    place = Path(tempfile.gettempdir())
    number = next(_numbers)
    for left in _hidden(place):
        found = _LEFT.fullmatch(left.name)
        if found and found["name"].startswith(f"{subject}-"):
            remove_dead(place, found["name"])
    with claimed(place / f"{subject}-{os.getpid()}-{number}") as scratch:
        yield scratch.folder


def inside_scratch(path: Path) -> bool:
    """Return whether a path is inside a run's scratch."""
    return any(_LEFT.fullmatch(one.name) for one in path.parents)


def put_in_place(scratch: Path, target: Path) -> None:
    """Rename a finished folder to its target, and remove the older one.

    At every moment either folder has the target's name.
    """
    if not target.exists():
        scratch.rename(target)
        return
    # After the exchange this is the older folder, which no run can resume.
    passing = _scratch_of(target, _NEW)
    if passing != scratch:
        scratch.rename(passing)
    try:
        if _exchange(passing, target):
            _remove(passing)
            return
        # Without an exchange, the older folder is renamed first; the next run restores it if this
        # one is killed in between.
        older = _scratch_of(target, _OLD)
        with alone(target.parent):
            target.rename(older)
            try:
                passing.rename(target)
            except OSError:
                older.rename(target)
                raise
        _remove(older)
    except OSError:
        if passing != scratch:
            passing.rename(scratch)
        raise


def remove_dead(folder: Path, name: str | None = None) -> None:
    """Remove scratch of dead runs in a folder, for the output ``name`` or for all."""
    with alone(folder):  # a run locks its scratch only after creating it
        for entry in _hidden(folder):
            found = _LEFT.fullmatch(entry.name)
            if (
                found
                and (name is None or found["name"] == _beginning(Path(name))[1:])
                and _is_dead(entry, int(found["process"]))
            ):
                _remove(entry)


def _refuse_windows(target: Path) -> None:
    if importlib.util.find_spec("fcntl") is None:
        raise InputError(
            "UrbanTwin writes nothing on Windows", file=target, expected="Linux, macOS, or WSL"
        )


def _clear(target: Path) -> None:
    """Restore replaced outputs of dead runs, and remove their scratch, except resumable states."""
    for left, _, its_key in _left(target):
        if left.suffix == _OLD and not target.exists():
            left.rename(target)
        elif its_key is None:
            _remove(left)


def _own(target: Path, key: str | None) -> Path:
    """Return the scratch folder: that of a dead run with the same key, or a new one."""
    mine = _scratch_of(target, _NEW if key is None else f".{key}{_PARTIAL}")
    for left, _, its_key in _left(target):
        if key is not None and its_key == key and not mine.exists():
            left.rename(mine)
    mine.mkdir(exist_ok=key is not None)
    return mine


def _scratch_of(target: Path, ending: str) -> Path:
    return target.with_name(f"{_beginning(target)}.{os.getpid()}{ending}")


def _beginning(target: Path) -> str:
    name = target.name
    if len(os.fsencode(name)) > _LONGEST:
        digest = hashlib.sha256(os.fsencode(name)).hexdigest()[:16]
        name = os.fsencode(name)[: _LONGEST - 17].decode(errors="ignore") + "-" + digest
    return f".{name}"


def _left(target: Path) -> list[tuple[Path, int, str | None]]:
    """Return the scratch of an output, its process and its key."""
    found = []
    for entry in _hidden(target.parent):
        match = _LEFT.fullmatch(entry.name)
        if match and match["name"] == _beginning(target)[1:]:
            found.append((entry, int(match["process"]), match["key"]))
    return found


def _hidden(folder: Path) -> list[Path]:
    try:
        with os.scandir(folder) as entries:
            return sorted(folder / one.name for one in entries if one.name.startswith("."))
    except OSError:  # no such folder, or not readable
        return []


def _is_dead(left: Path, process: int) -> bool:
    """Return whether the run that a scratch belongs to is over."""
    import fcntl

    try:
        lock = os.open(left, os.O_RDONLY | os.O_NOFOLLOW)
    except OSError:  # It is gone, or none of ours.
        return False
    try:
        # A shared lock, so that simultaneous checks do not see each other as owners.
        fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno not in _NO_LOCKS:
            return False
        try:  # without locks: does the process exist?
            os.kill(process, 0)
        except ProcessLookupError:
            return True
        except PermissionError:
            return False
        return False
    finally:
        os.close(lock)
    return True


def _lock(folder: Path) -> int:
    import fcntl

    lock = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX)  # waits for checks, which are short
    except OSError as error:
        if error.errno not in _NO_LOCKS:
            os.close(lock)
            raise
    _held.add(_identity(lock))
    return lock


def _close(lock: int | None) -> None:
    if lock is not None:
        _held.discard(_identity(lock))
        os.close(lock)


def _identity(descriptor: int) -> tuple[int, int]:
    found = os.fstat(descriptor)
    return found.st_dev, found.st_ino


@contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Serialise the runs' access to a folder."""
    import fcntl

    lock = os.open(folder, os.O_RDONLY)
    try:
        if _identity(lock) not in _held:  # our own scratch is private
            try:
                fcntl.flock(lock, fcntl.LOCK_EX)
            except OSError as error:
                if error.errno not in _NO_LOCKS:
                    raise
        yield
    finally:
        os.close(lock)


def _exchange(one: Path, other: Path) -> bool:
    """Exchange two paths atomically, where the system supports it (Linux)."""
    rename = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None)
    if rename is None:
        return False
    return bool(rename(_HERE, os.fsencode(one), _HERE, os.fsencode(other), _EXCHANGE) == 0)


def _make_parents(folder: Path) -> list[Path]:
    """Create a folder and its parents; return the created ones, innermost first."""
    missing = []
    for one in (folder, *folder.parents):
        if one.exists():
            break
        missing.append(one)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _not_writable(folder, error) from None
    return missing


def _not_writable(target: Path, error: OSError) -> InputError:
    why = (error.strerror or str(error)).lower()
    full = error.errno in (errno.ENOSPC, errno.EDQUOT)
    expected = "room on its disk" if full else "a place to write to"
    return InputError(f"cannot be written ({why})", file=target, expected=expected)


def _remove(left: Path) -> None:
    if left.is_dir() and not left.is_symlink():
        # Twice: a worker of a killed run may have been writing until now.
        shutil.rmtree(left, ignore_errors=True)
        if left.exists():
            shutil.rmtree(left, ignore_errors=True)
    else:
        with suppress(OSError):
            left.unlink()
