"""The course of a campaign: which steps are done, which can be made now, and what became of them.

It knows no more of those who make steps than that they take one and return what became of it: on a
pool of processes here, or on other machines that have the campaign's folder.
"""

from __future__ import annotations

import heapq
import time
from collections import Counter
from collections.abc import Callable, Mapping
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from urbantwin.campaigns.steps import KINDS, Step, Steps
from urbantwin.errors import StageError
from urbantwin.grid import Journal
from urbantwin.grid.journal import ATTEMPTS

__all__ = ["JOURNAL", "Course", "Measured", "Outcome", "Pool"]

#: Where in a campaign's folder it is noted what is done.
JOURNAL = "journal/steps.jsonl"
#: The course is told of so often while nothing ends, seconds.
_TOLD_S = 1.0


@dataclass
class Measured:
    """What steps of a kind took that were made, by this run or before.

    Attributes:
        steps: how many.
        work: of all of them, see `Step.work`.
        seconds: of processors.
        size: bytes.
    """

    steps: int = 0
    work: float = 0.0
    seconds: float = 0.0
    size: float = 0.0

    def add(self, step: Step, row: Mapping[str, Any]) -> None:
        """Count a step, and what is noted of it."""
        self.steps += 1
        self.work += step.work
        self.seconds += float(row.get("processor_s", 0.0))
        self.size += float(row.get("bytes", 0))


@dataclass(frozen=True)
class Outcome:
    """What became of a step.

    Attributes:
        told: of one that was made: what is noted of it, see `notes_of`.
        why: of one that failed.
        attempts: how often it was tried.
        no_room: whether it failed because the disk is full: then whatever comes next fails, too.
    """

    told: Mapping[str, Any] = field(default_factory=dict)
    why: str | None = None
    attempts: int = 1
    no_room: bool = False


class Pool(Protocol):
    """Who makes steps: as ``concurrent.futures`` has it."""

    def submit(self, function: Callable[[Step], Outcome], step: Step, /) -> Future[Outcome]:
        """Begin a step."""
        ...


class Course:
    """How far a campaign is.

    Args:
        steps: all of them.
        place: the campaign's folder.

    Attributes:
        steps: all of them.
        journal: what is noted of each, by its place.
        totals: how many steps there are of a kind.
        counts: how many steps of a kind are ``done``, ``failed``, ``running``; ``dropped``: not
            begun because what they need failed; ``unneeded``: no dataset lacks them.
        running: steps that are being made, and since when.
        failed: why, by the place of the step; those dropped, too.
        to_make: steps that were to be made when it began.
        work: of all steps that are to be made, by kind.
        gone: how much of it is done or given up.
        measured: what steps took, by kind.
        frames: recorded by this run.
    """

    def __init__(self, steps: Steps, place: Path) -> None:
        self.steps = steps
        self.place = place
        self.journal = Journal(place / JOURNAL)
        self.totals = Counter(one.kind for one in steps.all.values())
        self.counts: dict[str, Counter[str]] = {kind: Counter() for kind in KINDS}
        self.running: dict[str, float] = {}
        self.failed: dict[str, str] = {}
        self.work = dict.fromkeys(KINDS, 0.0)
        self.gone = dict.fromkeys(KINDS, 0.0)
        self.measured = {kind: Measured() for kind in KINDS}
        self.frames = 0
        self.began = time.monotonic()
        self._crashes: Counter[str] = Counter()
        self._waits: dict[str, list[Step]] = {}
        self._lacks: dict[str, int] = {}
        self._ready: list[tuple[int, int, str]] = []
        self.to_make: tuple[Step, ...] = ()
        self._number = {name: number for number, name in enumerate(steps.all)}
        self._plan()

    def is_done(self, step: Step) -> bool:
        """Return whether a step is made, of the same, and is there."""
        row = self.journal.row(step.place)
        return (
            row.get("state") == "done"
            and row.get("key") == step.key
            and (self.place / step.place / f"{step.kind}.json").is_file()
        )

    def _plan(self) -> None:
        """Find what is to be made: of twins and motions only those that a dataset lacks."""
        wanted: dict[str, Step] = {}
        for step in reversed(list(self.steps.all.values())):
            if self.is_done(step):
                self.counts[step.kind]["done"] += 1
                self.measured[step.kind].add(step, self.journal.row(step.place))
            elif step.kind == "dataset" or step.place in self._waits:
                wanted[step.place] = step
                for need in step.needs:
                    self._waits.setdefault(need, [])
            else:
                self.counts[step.kind]["unneeded"] += 1
        self.to_make = tuple(wanted.values())
        for step in wanted.values():
            self.work[step.kind] += step.work
            lacks = [need for need in step.needs if need in wanted]
            self._lacks[step.place] = len(lacks)
            for need in lacks:
                self._waits[need].append(step)
            if not lacks:
                self._enqueue(step)

    def _enqueue(self, step: Step) -> None:
        # What is needed for nothing else goes first: there are frames from the beginning on.
        rank = len(KINDS) - KINDS.index(step.kind)
        heapq.heappush(self._ready, (rank, self._number[step.place], step.place))

    @property
    def left(self) -> int:
        """How many steps are neither done nor given up."""
        return sum(self.left_of(kind) for kind in KINDS)

    def left_of(self, kind: str) -> int:
        """Return how many steps of a kind are neither done nor given up."""
        counted = self.counts[kind]
        return self.totals[kind] - sum(
            counted[one] for one in ("done", "failed", "dropped", "unneeded")
        )

    def run(
        self,
        pool: Pool,
        make: Callable[[Step], Outcome],
        *,
        abreast: int,
        tell: Callable[[Course], None],
        most: int | None = None,
    ) -> None:
        """Make all steps that are left.

        Args:
            pool: who makes them.
            make: makes one, and raises nothing.
            abreast: how many are under way at once.
            tell: called whenever something changed, and now and then.
            most: of datasets that are begun; ``None``: all.

        Raises:
            StageError: the disk is full.
            BrokenExecutor: a worker was killed; what it was at is tried again by another run.
        """
        under_way: dict[Future[Outcome], Step] = {}
        try:
            while True:
                while self._ready and len(under_way) < abreast:
                    step = self.steps.all[self._ready[0][2]]
                    if step.kind == "dataset" and most is not None:
                        if most <= 0:
                            break
                        most -= 1
                    heapq.heappop(self._ready)
                    self.running[step.place] = time.monotonic()
                    self.counts[step.kind]["running"] += 1
                    under_way[pool.submit(make, step)] = step
                    tell(self)
                if not under_way:
                    return
                ended, _ = wait(under_way, timeout=_TOLD_S, return_when=FIRST_COMPLETED)
                for future in ended:
                    try:
                        outcome = future.result()
                    except StageError as error:  # its machine was lost, several times
                        outcome = Outcome(why=str(error))
                    self._note(under_way.pop(future), outcome)
                tell(self)
        except BrokenExecutor:
            for step in under_way.values():
                self._crashed(step)
            raise
        finally:
            for step in under_way.values():
                if self.running.pop(step.place, None) is not None:
                    self.counts[step.kind]["running"] -= 1

    def _crashed(self, step: Step) -> None:
        """Try a step again whose worker, or another beside it, was killed."""
        self._crashes[step.place] += 1
        if self._crashes[step.place] < ATTEMPTS:
            self._enqueue(step)
        else:
            why = "a worker was killed (out of memory?); fewer workers need less"
            self._note(step, Outcome(why=why, attempts=ATTEMPTS))

    def _note(self, step: Step, outcome: Outcome) -> None:
        del self.running[step.place]
        counted = self.counts[step.kind]
        counted["running"] -= 1
        if outcome.no_room:
            self._enqueue(step)
            raise StageError(str(outcome.why))
        row: dict[str, Any] = {"key": step.key, "attempts": outcome.attempts}
        if outcome.why is not None:
            self.journal.note(step.place, state="failed", **row, why=outcome.why)
            self.failed[step.place] = outcome.why
            counted["failed"] += 1
            self.gone[step.kind] += step.work
            self._drop(step, outcome.why)
            return
        self.journal.note(step.place, state="done", **row, **outcome.told)
        counted["done"] += 1
        self.gone[step.kind] += step.work
        self.measured[step.kind].add(step, outcome.told)
        self.frames += int(outcome.told.get("frames", 0))
        for after in self._waits.get(step.place, ()):
            self._lacks[after.place] -= 1
            if not self._lacks[after.place]:
                self._enqueue(after)

    def _drop(self, step: Step, why: str) -> None:
        """Give up what needs a step that failed."""
        for after in self._waits.get(step.place, ()):
            if after.place not in self.failed:
                self.failed[after.place] = f"{step.place}: {why}"
                self.counts[after.kind]["dropped"] += 1
                self.gone[after.kind] += after.work
                self._drop(after, why)
