"""Progress of a running campaign: a table on a terminal, lines elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from urbantwin.artefact.disk_space import told_size
from urbantwin.experiments.course import KINDS
from urbantwin.experiments.workers import under_way
from urbantwin.interface.stage import ShowProgress, tell_line, tell_ray_tracer

if TYPE_CHECKING:
    from rich.table import Table

    from urbantwin.experiments.course import Course

__all__ = ["shown_course"]

Tell = Callable[["Course"], None]
#: Time between lines without a terminal, seconds.
_LINE_S = 10.0
#: Largest number of running, and of failed, steps listed.
_NAMED = 8


@contextmanager
def shown_course(name: str, progress: ShowProgress, abreast: int) -> Iterator[Tell]:
    """Yield a function that shows a campaign's course, to be called at each change.

    Args:
        name: name of the campaign's file.
        progress: see `stage.shown_stage`; a function is called with the fraction done.
        abreast: number of steps run in parallel.
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
            yield lambda course: live.update(_table(name, course, abreast))
    else:
        lines = _Lines()
        yield lines.show
        lines.end()


def _share(course: Course) -> float:
    return course.share_done({place: under_way(course, place)[0] for place in course.running})


def _counted(course: Course) -> str:
    """Return the counts of datasets: ``12 of 96 datasets, 3 running``."""
    counts = course.counts("dataset")
    words = [f"{counts['done']} of {counts.total()} datasets"]
    words += [f"{len(course.running)} running"] if course.running else []
    words += [f"{len(course.failed)} failed"] if course.failed else []
    return ", ".join(words)


def _rate(course: Course) -> str:
    took_s, share = time.monotonic() - course.began, _share(course)
    words = [f"{course.frames / took_s:.3g} frames/s"] if course.frames and took_s > 1 else []
    rows = [course.journal.row(step.place) for step in course.of("dataset")]
    words.append(told_size(sum(row.get("bytes", 0) for row in rows if row.get("state") == "done")))
    if share > 0.02 and took_s > 10:
        words.append(f"about {_time(took_s * (1 - share) / share)} to go")
    return ", ".join(words)


def _table(name: str, course: Course, abreast: int) -> Table:
    from rich.markup import escape
    from rich.table import Table

    table = Table(title=f"campaign {name}", title_justify="left")
    for column in ("", "all", "done", "running", "failed", "left"):
        table.add_column(column, justify="left" if not column else "right")
    for kind in KINDS:
        counts = course.counts(kind)
        failed = counts["failed"] + counts["dropped"]
        row = [counts.total(), counts["done"], counts["running"], failed, counts["waiting"]]
        if counts:
            table.add_row(f"{kind}s", *map(str, row))
    lines = [f"{_rate(course)}, {abreast} at once"]
    for place, since_s in list(course.running.items())[:_NAMED]:
        share, doing = under_way(course, place)
        lines.append(f"{place}: {share:.0%}, {_time(time.monotonic() - since_s)} {doing}")
    lines += [f"failed {place}: {why}" for place, why in list(course.failed.items())[-_NAMED:]]
    table.caption = "\n".join(escape(line[:200]) for line in lines)
    table.caption_justify = "left"
    return table


class _Lines:
    """Prints progress lines on stderr at intervals, and a line per failed step at once."""

    def __init__(self) -> None:
        self._last_s = time.monotonic() - _LINE_S + 1.0  # first line after a second
        self._failed: set[str] = set()
        self._course: Course | None = None

    def show(self, course: Course) -> None:
        """Print the lines that are due."""
        self._course = course
        for place, why in course.failed.items():
            if place not in self._failed:
                self._failed.add(place)
                tell_line(f"campaign: failed: {place}: {why}")
        if time.monotonic() - self._last_s >= _LINE_S:
            self._last_s = time.monotonic()
            tell_line(f"campaign: {_counted(course)}; {_rate(course)}")

    def end(self) -> None:
        """Print the final counts."""
        if self._course is not None:
            took = _time(time.monotonic() - self._course.began)
            tell_line(f"campaign: {_counted(self._course)} in {took}")


def _time(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    hours, minutes = divmod(round(seconds / 60), 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min"
