"""Where the command line writes: results on stdout, progress and errors on stderr."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from urbantwin.errors import readable

__all__ = ["Console", "ProgressCallback", "error_line"]

#: What every long function calls: the fraction that is done (0..1) and what is being done.
ProgressCallback = Callable[[float, str], None]
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

    @contextmanager
    def stage(self, title: str) -> Iterator[ProgressCallback]:
        """Show one stage while the block runs: a bar on a terminal, plain lines elsewhere."""
        if self.quiet:
            yield lambda fraction, doing: None
        elif sys.stderr.isatty():
            with _bar(title) as callback:
                yield callback
        else:
            with _lines(title) as callback:
                yield callback


@contextmanager
def _bar(title: str) -> Iterator[ProgressCallback]:
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
    with Progress(*columns, console=RichConsole(stderr=True)) as progress:
        task = progress.add_task(title, total=1.0, doing="")

        def callback(fraction: float, doing: str) -> None:
            progress.update(task, completed=fraction, doing=doing)

        yield callback
        progress.update(task, completed=1.0, doing="done")


@contextmanager
def _lines(title: str) -> Iterator[ProgressCallback]:
    """Print a line after a second, one at every tenth (at most one a second), one at the end.

    What fails within the first second has then printed nothing but its error.
    """
    began = last = time.monotonic()
    tenth = -1

    def callback(fraction: float, doing: str) -> None:
        nonlocal last, tenth
        now = time.monotonic()
        if int(fraction * 10) > tenth and now - last >= 1.0:
            last, tenth = now, int(fraction * 10)
            print(f"{title}: {fraction:.0%}, {doing}", file=sys.stderr, flush=True)

    yield callback
    print(f"{title}: done in {time.monotonic() - began:.1f} s", file=sys.stderr, flush=True)


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
