"""Cache files, written atomically; several runs may share the folder."""

from __future__ import annotations

import os
import threading
import time
from contextlib import suppress
from pathlib import Path

from urbantwin.errors import InputError

__all__ = ["keep_bytes", "kept_bytes"]

#: Age after which an unfinished file is considered left by a killed run, seconds.
_FORGOTTEN_S = 3600.0


_ELSE = "a folder of your own with room, or no cache"


def kept_bytes(path: Path, expected: str = _ELSE) -> bytes | None:
    """Return the bytes at a path of the folder, or ``None``.

    Args:
        path: path of the file.
        expected: advice to the user if the folder is not usable.

    Raises:
        InputError: the file cannot be read.
    """
    try:
        return path.read_bytes()
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise _useless("read", path, error, expected) from None


def keep_bytes(path: Path, data: bytes, expected: str = _ELSE) -> None:
    """Write bytes to a path of the folder atomically.

    Args:
        path: path of the file.
        data: the bytes.
        expected: see `kept_bytes`.

    Raises:
        InputError: no space, or no permission.
    """
    scratch = path.with_name(f"{path.name}.{os.getpid()}-{threading.get_ident()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        for old in path.parent.glob("*.part"):
            with suppress(FileNotFoundError):  # just renamed by its writer
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
