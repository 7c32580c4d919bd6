"""The command ``urbantwin``, and ``python -m urbantwin``."""

import gc
import os
import sys
from contextlib import suppress
from typing import NoReturn

from urbantwin.interruption import ends_at_once, leave

__all__ = ["main"]

ends_at_once()  # before the slow imports of the commands
# Imported objects stay alive, and searching them for garbage would take a tenth of the time:
# collect after ten times as many allocations as Python's default.
gc.set_threshold(7_000, 10, 10)


def main() -> NoReturn:
    """Run the command line, and end with its exit code; see `urbantwin.cli.main`."""
    _use_utf8()
    from urbantwin.cli import main as run

    leave(run())


def _use_utf8() -> None:
    """Restart in UTF-8 mode if the locale has another encoding, as ``LC_ALL=C`` may.

    Input files name other files in UTF-8, which Python would otherwise decode differently. Output
    keeps the locale's encoding.
    """
    if sys.getfilesystemencoding() == "utf-8" or os.environ.get("PYTHONUTF8") == "1":
        return
    os.environ |= {"PYTHONUTF8": "1", "LC_ALL": "C.UTF-8"}  # LC_ALL is for SUMO's programs
    if sys.stdout is not None:
        os.environ.setdefault("PYTHONIOENCODING", f"{sys.stdout.encoding}:backslashreplace")
    with suppress(OSError):
        os.execv(sys.executable, [sys.executable, *sys.orig_argv[1:]])


if __name__ == "__main__":
    main()
