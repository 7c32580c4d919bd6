"""Single-file outputs: which ones urbantwin wrote, and which may be replaced.

A folder with such outputs has a record, ``.urbantwin-files``, with name, kind and SHA-256 of each.
A file is replaced only if the record lists it for the same kind of output and it is unchanged; any
other file requires the user's ``--overwrite``.
"""

from __future__ import annotations

import json
import os
import stat
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path

from urbantwin.artefact.checksum import sha256_of
from urbantwin.artefact.scratch import inside_scratch
from urbantwin.errors import InputError

__all__ = ["RECORD", "check_replaceable_file", "overwriting", "publish_file", "take_mode"]

RECORD = ".urbantwin-files"
#: A longer record is none of ours, bytes.
_LONGEST = 4 << 20
_NO_FILE = {
    stat.S_IFIFO: "a pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}
_overwriting: ContextVar[bool] = ContextVar("overwriting", default=False)


@contextmanager
def overwriting(allowed: bool) -> Iterator[None]:
    """Let outputs replace files that we did not write, while the block runs."""
    before = _overwriting.set(allowed)
    try:
        yield
    finally:
        _overwriting.reset(before)


def check_replaceable_file(target: Path, real: Path, kind: str | None) -> None:
    """Check that an output is free, or is an unchanged file that urbantwin wrote for it.

    Args:
        target: the output as named by the user.
        real: the output without symbolic links.
        kind: kind of output; ``None`` if no file may be replaced without ``--overwrite``.

    Raises:
        InputError: not a regular file; or a file of other origin, changed since it was written, or
            read-only, without ``--overwrite``.
    """
    try:
        found = real.stat()
    except FileNotFoundError:
        return
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", file=target) from None
    if stat.S_ISDIR(found.st_mode):
        raise InputError("is a folder", file=target, expected="the name of a file")
    if not stat.S_ISREG(found.st_mode):
        what = _NO_FILE.get(stat.S_IFMT(found.st_mode), "no regular file")
        raise InputError(f"is {what}", file=target, expected="the name of a file")
    if _overwriting.get():
        return
    if not found.st_mode & 0o222 or not os.access(real, os.W_OK):
        problem = "is read-only"
    elif (known := _read(real.parent).get(real.name)) is None:
        problem = "exists, and urbantwin did not write it"
    elif known["kind"] != kind:
        problem = f"exists, and is another output of urbantwin ({known['kind']})"
    elif sha256_of(real) not in known["sha256"]:
        problem = "was changed after urbantwin wrote it"
    else:
        return
    raise InputError(problem, file=target, expected="another name, or --overwrite")


def publish_file(file: Path, real: Path, kind: str | None, *, target: Path | None = None) -> None:
    """Rename a finished file to an output, if an existing file may be replaced.

    Args:
        file: the finished file, on the same file system.
        real: the output, without symbolic links.
        kind: kind of output; ``None`` to not record it.
        target: the output as named by the user.

    Raises:
        InputError: see `check_replaceable_file`.
    """
    check_replaceable_file(real if target is None else target, real, kind)
    if kind is not None:
        _note(file, real, kind)
    take_mode(file, real)
    file.replace(real)


def _note(file: Path, real: Path, kind: str) -> None:
    """Record a finished file that is about to replace an output.

    The existing file stays recorded, so that after a kill in between either file is known.

    Args:
        file: the finished file.
        real: the output, without symbolic links.
        kind: kind of output.
    """
    if inside_scratch(real):  # part of an artefact with an inventory
        return
    noted = {
        name: value for name, value in _read(real.parent).items()
        if os.path.lexists(real.parent / name)
    }  # fmt: skip
    before = noted.get(real.name)
    older = before["sha256"][-1:] if before is not None and before["kind"] == kind else []
    noted[real.name] = {"kind": kind, "sha256": list(dict.fromkeys([*older, sha256_of(file)]))}
    record = real.parent / RECORD
    passing = file.with_name(f"{RECORD}.new")
    try:
        passing.write_text(json.dumps(dict(sorted(noted.items())), indent=1), encoding="utf-8")
        passing.replace(record)
    finally:
        with suppress(OSError):
            passing.unlink()


def take_mode(file: Path, real: Path) -> None:
    """Copy mode and owner of an existing output to the file or folder that replaces it."""
    with suppress(FileNotFoundError):
        found = real.stat()
        with suppress(PermissionError):
            if hasattr(os, "geteuid") and os.geteuid() == 0:  # not on Windows
                os.chown(file, found.st_uid, found.st_gid)
            file.chmod(stat.S_IMODE(found.st_mode))


def _read(folder: Path) -> Mapping[str, dict[str, str | list[str]]]:
    """Return the record of a folder; empty if damaged or missing."""
    record = folder / RECORD
    try:
        if not stat.S_ISREG(record.lstat().st_mode) or record.stat().st_size > _LONGEST:
            return {}
        value = json.loads(record.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    if not isinstance(value, dict):
        return {}
    return {name: one for name, one in value.items() if _is_entry(one)}


def _is_entry(value: object) -> bool:
    return (
        isinstance(value, dict)
        and isinstance(value.get("kind"), str)
        and isinstance(value.get("sha256"), list)
        and all(isinstance(one, str) for one in value["sha256"])
    )
