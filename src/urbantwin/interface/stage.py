"""Progress display of stages (bar, plain lines or callback), and messages about their results."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from html import escape
from pathlib import Path
from typing import Any

from urbantwin.progress import Progress, untold
from urbantwin.result_warning import ResultWarning

__all__ = ["ShowProgress", "shown_stage", "tell_line", "tell_ray_tracer", "tell_result"]

#: Type of ``progress``: whether to show it, or a function that is called with the fraction done
#: (0..1, per stage) and a description.
ShowProgress = bool | Progress

#: Stages that cast rays; the first one in a run reports a missing Embree.
_CASTS_RAYS = frozenset(
    "align background calibrate coverage film init place record replay study suite traffic tune "
    "twin".split()
)
#: Longest time between two lines, seconds.
_LONGEST_S = 10.0
#: Shortest time between two updates of a notebook's bar, seconds.
_REDRAWN_S = 0.1
#: A usually brief stage is shown only after this time, seconds.
_BRIEF_S = 1.0


@contextmanager
def shown_stage(
    title: str, progress: ShowProgress = True, *, brief: bool = False
) -> Iterator[Progress]:
    """Show a stage while the block runs; yield the function that reports its progress.

    Args:
        title: name of the stage.
        progress: True for a bar in a notebook and on a terminal, and plain lines on stderr
            elsewhere; False for nothing; or a function that is called instead.
        brief: whether the stage is usually over at once; then nothing is shown at first.
    """
    if progress is False:
        yield untold
    elif progress is not True:
        yield progress
    else:
        if title in _CASTS_RAYS:
            tell_ray_tracer()
        display = _notebook_bar if _in_notebook() else _bar if sys.stderr.isatty() else _lines
        with display(title, brief=brief) as callback:
            yield callback


def tell_result(
    title: str,
    folder: Path,
    warnings: Iterable[ResultWarning],
    progress: ShowProgress = True,
) -> None:
    """Print on stderr where the pictures of a result are, and its warnings, one per line.

    Args:
        title: name of the stage.
        folder: the result's folder; its pictures are in ``pictures``.
        warnings: the result's warnings.
        progress: as for `shown_stage`; nothing is printed if no progress is shown.
    """
    if progress is not True:
        return
    if (folder / "pictures").is_dir():
        tell_line(f"{title}: pictures in {folder / 'pictures'}", progress)
    for one in warnings:
        tell_line(f"warning: {one}", progress)


def tell_line(text: str, progress: ShowProgress = True) -> None:
    """Print a line on stderr, unless progress is hidden."""
    if progress is True:
        with suppress(OSError, ValueError):  # stderr is closed
            print(text, file=sys.stderr, flush=True)


@cache
def tell_ray_tracer() -> None:
    """Print on stderr, once per process, that Embree is missing, if it is."""
    from urbantwin.geometry.rays import missing_embree

    if text := missing_embree():
        tell_line(f"warning: {text}")


def _in_notebook() -> bool:
    """Return whether a Jupyter kernel runs this: IPython is loaded and has a kernel."""
    shell = sys.modules.get("IPython")
    return shell is not None and getattr(shell.get_ipython(), "kernel", None) is not None


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


class _NotebookBar:
    """A progress bar in the output of a cell, as HTML without notebook extensions.

    rich's own bar for notebooks needs ipywidgets, which JupyterLab alone does not install.
    """

    def __init__(self, title: str, *, brief: bool) -> None:
        self.title = title
        self.began = time.monotonic()
        self.shown_s = self.began + (_BRIEF_S if brief else 0.0)
        self.share, self.doing = 0.0, ""
        self.handle: Any = None

    def told(self, share: float, doing: str) -> None:
        """Store the progress, and draw the bar if due."""
        self.share, self.doing = max(self.share, share), doing
        if time.monotonic() >= self.shown_s:
            self.draw(doing)

    def draw(self, words: str) -> None:
        """Draw the bar."""
        shell: Any = sys.modules["IPython.display"]  # loaded by the kernel, so no dependency
        now = time.monotonic()
        self.shown_s = now + _REDRAWN_S
        drawn = shell.HTML(
            f'<progress value="{self.share:.4f}" max="1"></progress> '
            f"{escape(self.title)} {self.share:.0%}, {now - self.began:.0f} s: {escape(words)}"
        )
        if self.handle is None:
            self.handle = shell.display(drawn, display_id=True)
        else:
            self.handle.update(drawn)


@contextmanager
def _notebook_bar(title: str, *, brief: bool) -> Iterator[Progress]:
    bar = _NotebookBar(title, brief=brief)
    try:
        yield bar.told
    except BaseException:
        if bar.handle is not None:
            bar.draw(f"stopped ({bar.doing})" if bar.doing else "stopped")
        raise
    bar.share = 1.0
    if bar.handle is not None or not brief:
        bar.draw("done")


class _Lines:
    """Prints the progress of a stage as lines.

    Prints a line after one second, at every tenth (at most one per second), and after a longer
    silence even if the stage reports nothing. A stage that fails within the first second prints
    only its error. The fraction never falls.
    """

    def __init__(self, title: str, longest_s: float) -> None:
        self.title, self.longest_s = title, longest_s
        self.began = self.last = time.monotonic()
        self.share, self.doing, self.tenth = 0.0, "", -1
        self.said = False
        self.lock = threading.Lock()
        self.over = threading.Event()

    def told(self, share: float, doing: str) -> None:
        """Store the progress, and print it if due."""
        with self.lock:
            self.share, self.doing = max(self.share, share), doing
            waited = time.monotonic() - self.last
            if waited >= self.longest_s or (int(self.share * 10) > self.tenth and waited >= 1.0):
                self.say(f"{self.share:.0%}, {self.doing}")

    def watch(self) -> None:
        """Print the elapsed time during a long silence of the stage."""
        while not self.over.wait(min(1.0, self.longest_s / 4)):
            with self.lock:
                now = time.monotonic()
                if now - self.last >= self.longest_s and not self.over.is_set():
                    doing = f", {self.doing}" if self.doing else ""
                    self.say(f"{self.share:.0%}{doing}, {now - self.began:.0f} s so far")

    def say(self, words: str) -> None:
        """Print a line."""
        self.last, self.tenth, self.said = time.monotonic(), int(self.share * 10), True
        with suppress(OSError, ValueError):  # stderr is closed
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
