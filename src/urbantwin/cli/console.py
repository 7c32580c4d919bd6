"""Where the command line writes: results on stdout, remarks and errors on stderr."""

from __future__ import annotations

import codecs
import io
import json
import sys
from typing import Any

from urbantwin.errors import readable
from urbantwin.interface.summary import Listing

__all__ = ["Console", "error_line", "show_any_letter"]

#: Most characters of an error on a terminal.
LONGEST_LINE = 1500


class Console:
    """The two streams of one command.

    Args:
        quiet: print nothing but errors.
        as_json: stdout gets one JSON document and nothing else.
    """

    def __init__(self, *, quiet: bool = False, as_json: bool = False) -> None:
        self.quiet = quiet
        self.as_json = as_json

    def result(self, made: Any) -> None:  # noqa: ANN401
        """Print what a command made or found; then serve it, or refuse what is wrong with it."""
        if hasattr(made, "wait"):  # a page that is served
            made.wait(lambda: self.show(made))
        else:
            self.show(made)
        if hasattr(made, "check"):
            made.check()

    def show(self, made: Any) -> None:  # noqa: ANN401
        """Print a result: for a script as JSON, for a person as lines, quietly names at most."""
        if self.as_json:
            utf8 = codecs.lookup(sys.stdout.encoding or "ascii").name == "utf-8"
            text = json.dumps(made.summary(), indent=2, ensure_ascii=not utf8, allow_nan=False)
            # Halves of letters, which names in files may hold, are written as JSON escapes them.
            print(text.encode(errors="backslashreplace").decode(), flush=True)
        elif not self.quiet:
            print(made.text(), flush=True)
        elif isinstance(made, Listing):
            print("\n".join(made.names))


def show_any_letter() -> None:
    """Let stdout and stderr show letters that the terminal's encoding lacks as escapes."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def error_line(problem: object) -> None:
    """Print ``error: ...`` on stderr, as one line."""
    print("error:", readable(str(problem), LONGEST_LINE), file=sys.stderr)
