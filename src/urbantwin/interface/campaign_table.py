"""A campaign as it is shown while it runs: a table on a terminal, lines elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from urbantwin.artefact.disk_space import told_size
from urbantwin.campaigns.costs import share_done
from urbantwin.campaigns.steps import KINDS
from urbantwin.interface.campaign_step import RUNNING
from urbantwin.interface.stage import ShowProgress, tell_line, tell_ray_tracer

if TYPE_CHECKING:
    from rich.table import Table

    from urbantwin.campaigns import Course

__all__ = ["shown_course"]

Tell = Callable[["Course"], None]
#: Between lines where there is no terminal, seconds.
_LINE_S = 10.0
#: So many steps that run, and that failed, are named.
_NAMED = 8


@contextmanager
def shown_course(progress: ShowProgress, abreast: int) -> Iterator[Tell]:
    """Yield what is told of a campaign's course whenever something changed.

    Args:
        progress: see `stage.shown_stage`; a function is told the share of the work that is done.
        abreast: how many steps are made at once.
    """
    if progress is True:
        tell_ray_tracer()
    if progress is False:
        yield lambda _course: None
    elif progress is not True:
        yield lambda course: progress(_share(course), _counted(course))
    elif sys.stderr.isatty():
        from rich.console import Console
        from rich.live import Live

        with Live(console=Console(stderr=True), refresh_per_second=4) as live:
            yield lambda course: live.update(_table(course, abreast))
    else:
        lines = _Lines(abreast)
        yield lines.told
        lines.end()


def _share(course: Course) -> float:
    return share_done(course, {place: _said(course, place)[0] for place in course.running})


def _said(course: Course, place: str) -> tuple[float, str]:
    """Return the share of a running step that is done, and what it is at."""
    kind, _, name = place.partition("s/")
    share, doing = 0.0, ""
    with suppress(OSError, ValueError):
        text = (course.place / RUNNING / f"{kind}-{name}").read_text(encoding="utf-8")
        share = float(text.partition(" ")[0])
        doing = text.partition(" ")[2]
    return min(max(share, 0.0), 1.0), doing


def _left_s(course: Course) -> float | None:
    """Return how long it will take by what this run took so far; ``None``: too early to say."""
    share, took = _share(course), time.monotonic() - course.began
    return took * (1 - share) / share if share > 0.02 and took > 10 else None


def _counted(course: Course) -> str:
    """Return the datasets that are done, run and failed: ``12 of 96 datasets, 3 running``."""
    counted = course.counts["dataset"]
    words = [f"{counted['done']} of {course.totals['dataset']} datasets"]
    running = len(course.running)
    failed = len(course.failed)
    words += [f"{running} running"] * (running > 0) + [f"{failed} failed"] * (failed > 0)
    return ", ".join(words)


def _rate(course: Course) -> str:
    took = time.monotonic() - course.began
    words = [f"{course.frames / took:.3g} frames/s"] if course.frames and took > 1 else []
    words.append(told_size(course.measured["dataset"].size))
    left = _left_s(course)
    if left is not None:
        words.append(f"about {_time(left)} to go")
    return ", ".join(words)


def _table(course: Course, abreast: int) -> Table:
    from rich.markup import escape
    from rich.table import Table

    table = Table(title=f"campaign {course.steps.asked.file.name}", title_justify="left")
    for name in ("", "all", "done", "running", "failed", "left"):
        table.add_column(name, justify="left" if not name else "right")
    for kind in KINDS:
        counted = course.counts[kind]
        failed = counted["failed"] + counted["dropped"]
        row = [course.totals[kind], counted["done"], counted["running"], failed]
        left = course.left_of(kind) - counted["running"]
        if course.totals[kind]:
            table.add_row(f"{kind}s", *map(str, (*row, left)))
    lines = [f"{_rate(course)}, {abreast} at once"]
    for place, since in list(course.running.items())[:_NAMED]:
        share, doing = _said(course, place)
        lines.append(f"{place}: {share:.0%}, {_time(time.monotonic() - since)} {doing}")
    lines += [f"failed {place}: {why}" for place, why in list(course.failed.items())[-_NAMED:]]
    table.caption = "\n".join(escape(one[:200]) for one in lines)
    table.caption_justify = "left"
    return table


class _Lines:
    """Lines on stderr: one now and then, and one for each step that failed, at once."""

    def __init__(self, abreast: int) -> None:
        self._last = time.monotonic() - _LINE_S + 1.0  # the first after a second
        self._failed: set[str] = set()
        self._abreast = abreast
        self._course: Course | None = None

    def told(self, course: Course) -> None:
        """Say what is to be said of a course now."""
        self._course = course
        for place, why in course.failed.items():
            if place not in self._failed:
                self._failed.add(place)
                tell_line(f"campaign: failed: {place}: {why}")
        if time.monotonic() - self._last >= _LINE_S:
            self._last = time.monotonic()
            tell_line(f"campaign: {_counted(course)}; {_rate(course)}")

    def end(self) -> None:
        """Say how it ended."""
        if self._course is not None:
            took = _time(time.monotonic() - self._course.began)
            tell_line(f"campaign: {_counted(self._course)} in {took}")


def _time(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    hours, minutes = divmod(round(seconds / 60), 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min"
