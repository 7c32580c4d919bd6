"""Where the command line writes: results on stdout, progress and errors on stderr."""

from __future__ import annotations

import json
import sys
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any

from urbantwin.errors import readable
from urbantwin.progress import Progress, untold

__all__ = ["Console", "error_line"]

#: Nobody waits longer than this for a line, seconds.
_LONGEST_S = 10.0
#: Most characters of an error, or of a text that a result holds, on a terminal.
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

    def result(self, value: Mapping[str, Any]) -> None:
        """Print what a command made or found: for a script as JSON, for a person as lines."""
        if self.as_json:
            text = json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False)
            # Halves of letters, which names in files may hold, are written as JSON escapes them.
            print(text.encode(errors="backslashreplace").decode())
        elif not self.quiet:
            print("\n".join(_lines_of(value)))

    def note(self, text: str) -> None:
        """Print a line for a person beside the result."""
        if not self.quiet:
            print(text, file=sys.stderr, flush=True)

    @contextmanager
    def stage(self, title: str, *, brief: bool = False) -> Iterator[Progress]:
        """Show one stage while the block runs: a bar on a terminal, plain lines elsewhere.

        Args:
            title: what the stage is called.
            brief: it is over at once as a rule, and then nothing is shown.
        """
        if self.quiet:
            yield untold
        elif sys.stderr.isatty():
            with _bar(title, brief=brief) as callback:
                yield callback
        else:
            with _lines(title, brief=brief) as callback:
                yield callback


@contextmanager
def _bar(title: str, *, brief: bool) -> Iterator[Progress]:
    from rich.console import Console as RichConsole
    from rich.progress import (
        BarColumn,
        Progress,
        TaskProgressColumn,
        TextColumn,
        TimeElapsedColumn,
    )

    columns: list[Any] = [
        TextColumn("{task.description:<8}"),
        BarColumn(),
        TaskProgressColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[doing]}"),
    ]
    with Progress(*columns, console=RichConsole(stderr=True), transient=brief) as progress:
        task = progress.add_task(title, total=1.0, doing="")
        most = 0.0

        def callback(share: float, doing: str) -> None:
            nonlocal most
            most = max(most, share)
            progress.update(task, completed=most, doing=doing)

        yield callback
        progress.update(task, completed=1.0, doing="done")


class _Lines:
    """What is said of a stage, line by line, and when.

    A line after a second, one at every tenth (at most one a second), and one when the last is
    long ago, whether or not the stage tells anything meanwhile. What fails within the first
    second has printed nothing but its error. The share never falls.
    """

    def __init__(self, title: str, longest_s: float) -> None:
        self.title, self.longest_s = title, longest_s
        self.began = self.last = time.monotonic()
        self.share, self.doing, self.tenth = 0.0, "", -1
        self.said = False
        self.lock = threading.Lock()
        self.over = threading.Event()

    def told(self, share: float, doing: str) -> None:
        """Note how far the stage is, and say it if it is time."""
        with self.lock:
            self.share, self.doing = max(self.share, share), doing
            waited = time.monotonic() - self.last
            if waited >= self.longest_s or (int(self.share * 10) > self.tenth and waited >= 1.0):
                self.say(f"{self.share:.0%}, {self.doing}")

    def watch(self) -> None:
        """Say how long the stage has been at it when it tells nothing for long."""
        while not self.over.wait(min(1.0, self.longest_s / 4)):
            with self.lock:
                now = time.monotonic()
                if now - self.last >= self.longest_s and not self.over.is_set():
                    doing = f", {self.doing}" if self.doing else ""
                    self.say(f"{self.share:.0%}{doing}, {now - self.began:.0f} s so far")

    def say(self, words: str) -> None:
        """Print a line."""
        self.last, self.tenth, self.said = time.monotonic(), int(self.share * 10), True
        with suppress(OSError, ValueError):  # nobody listens any more
            print(f"{self.title}: {words}", file=sys.stderr, flush=True)


@contextmanager
def _lines(title: str, *, brief: bool = False, longest_s: float = _LONGEST_S) -> Iterator[Progress]:
    lines = _Lines(title, longest_s)
    watch = threading.Thread(target=lines.watch, daemon=True)
    watch.start()
    try:
        yield lines.told
    finally:
        lines.over.set()
        watch.join()
    if lines.said or not brief:
        lines.say(f"done in {time.monotonic() - lines.began:.1f} s")


def error_line(problem: object) -> None:
    """Print ``error: ...`` on stderr, as one line."""
    print("error:", readable(str(problem), LONGEST_LINE), file=sys.stderr)


def _lines_of(value: Mapping[str, Any], indent: str = "") -> Iterator[str]:
    """Yield ``key: value`` lines, what is inside a mapping or a list of mappings set in."""
    for key, item in value.items():
        if isinstance(item, Mapping) and not _fits_a_line(item):
            yield f"{indent}{_inline(key)}:"
            yield from _lines_of(item, indent + "  ")
        elif isinstance(item, list) and any(isinstance(one, Mapping) for one in item):
            yield f"{indent}{_inline(key)}:"
            yield from (f"{indent}  - {_inline(one)}" for one in item)
        elif isinstance(item, list) and len(item) > 1 and all(isinstance(x, str) for x in item):
            yield f"{indent}{_inline(key)}:"
            yield from (f"{indent}  {_inline(one)}" for one in item)
        elif item not in (None, []):
            yield f"{indent}{_inline(key)}: {_inline(item)}"


def _fits_a_line(value: Mapping[str, Any]) -> bool:
    return len(value) <= 3 and all(isinstance(one, float) for one in value.values())


def _inline(value: object) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{_inline(key)} {_inline(one)}" for key, one in value.items())
    if isinstance(value, list | tuple):
        return ", ".join(map(_inline, value))
    return readable(value, LONGEST_LINE) if isinstance(value, str) else str(value)
