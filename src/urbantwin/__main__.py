"""The command ``urbantwin``, and ``python -m urbantwin``."""

import gc
import os
import sys
from contextlib import suppress
from typing import NoReturn

from urbantwin.interruption import ends_at_once, leave

__all__ = ["main"]

ends_at_once()  # before the imports of the commands, which take a while
# What is imported stays, and a tenth of the time would go into looking for garbage in it: looked
# for after ten times as many objects as Python does by itself.
gc.set_threshold(7_000, 10, 10)


def main() -> NoReturn:
    """Run the command line, and end with its exit code; see `urbantwin.cli.main`."""
    _use_utf8()
    from urbantwin.cli import main as run

    leave(run())


def _use_utf8() -> None:
    """Begin again in UTF-8 mode where the locale has another encoding, as ``LC_ALL=C`` may.

    Files that we read name others, in UTF-8, and Python would look for other names. What is shown
    stays in the locale's encoding.
    """
    if sys.getfilesystemencoding() == "utf-8" or os.environ.get("PYTHONUTF8") == "1":
        return
    os.environ |= {"PYTHONUTF8": "1", "LC_ALL": "C.UTF-8"}  # the latter for SUMO's programs
    if sys.stdout is not None:
        os.environ.setdefault("PYTHONIOENCODING", f"{sys.stdout.encoding}:backslashreplace")
    with suppress(OSError):
        os.execv(sys.executable, [sys.executable, *sys.orig_argv[1:]])


if __name__ == "__main__":
    main()
