"""Files of a cache: each is there whole or not at all; several runs may share the folder."""

from __future__ import annotations

import os
import threading
import time
from contextlib import suppress
from pathlib import Path

from urbantwin.errors import InputError

__all__ = ["keep_bytes", "kept_bytes"]

#: A file that is still being written after so long is a killed run's, seconds.
_FORGOTTEN_S = 3600.0


_ELSE = "a folder of your own with room, or no cache"


def kept_bytes(path: Path, expected: str = _ELSE) -> bytes | None:
    """Return what was kept at a path of the folder, or ``None``.

    Args:
        path: where it was kept.
        expected: what a person is told to give where the folder is of no use.

    Raises:
        InputError: it cannot be read.
    """
    try:
        return path.read_bytes()
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise _useless("read", path, error, expected) from None


def keep_bytes(path: Path, data: bytes, expected: str = _ELSE) -> None:
    """Keep bytes at a path of the folder, whole or not at all.

    Args:
        path: where they are to be.
        data: the bytes.
        expected: as `kept_bytes` takes it.

    Raises:
        InputError: there is no room, or it may not be written.
    """
    scratch = path.with_name(f"{path.name}.{os.getpid()}-{threading.get_ident()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        for old in path.parent.glob("*.part"):
            with suppress(FileNotFoundError):  # its writer has just given it its name
                if time.time() - old.stat().st_mtime > _FORGOTTEN_S:
                    old.unlink()
        try:
            scratch.write_bytes(data)
            scratch.replace(path)
        finally:
            scratch.unlink(missing_ok=True)
    except OSError as error:
        raise _useless("written", path, error, expected) from None


def _useless(what: str, path: Path, error: OSError, expected: str) -> InputError:
    return InputError(f"cannot be {what} ({error.strerror})", file=path, expected=expected)
