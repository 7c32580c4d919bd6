"""Course of an experiment: state and outcome of its steps, and scheduling.

Workers only take a step and return its outcome: in this process, in a pool of processes, or on
machines that share the experiment's folder.
"""

from __future__ import annotations

import heapq
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from urbantwin.errors import StageError
from urbantwin.experiments.journal import ATTEMPTS, Journal

__all__ = ["KINDS", "Course", "Outcome", "Plan", "Pool", "Step"]

#: Kinds of steps; each needs those before it, and has a folder with its name and an s.
KINDS = ("twin", "motion", "dataset")
#: Longest time between two calls of ``tell`` while no step ends, seconds.
_TELL_EVERY_S = 1.0
#: States of a step that no run will change.
_ENDED = ("done", "failed", "dropped")
#: Estimates without measurements, per unit of a step's work: seconds of one processor, and bytes of
#: points as ``npy``. Sources are in notebook/scale.md.
_ESTIMATES = {"twin": (60.0, 0.0), "motion": (0.5, 0.0), "dataset": (4e-7, 17.0)}
#: Size of other storages relative to ``npy``.
_PACKED = {"npy": 1.0, "zstd": 0.36, "laz": 0.2}


@dataclass(frozen=True)
class Step:
    """A step, run once.

    Attributes:
        kind: one of `KINDS`.
        name: name of its folder, within that of its kind.
        key: hash of all its inputs.
        needs: places of the required earlier steps.
        cell: levels of the axes that determine it.
        size: seconds of a motion, frames of a dataset; 1 for a twin.
        rays: rays per frame, for a dataset.
    """

    kind: str
    name: str
    key: str
    needs: tuple[str, ...]
    cell: Mapping[str, Any]
    size: float = 1.0
    rays: int = 0

    @property
    def place(self) -> str:
        """Its folder in the experiment's: ``motions/two-avenues-1-none``."""
        return f"{self.kind}s/{self.name}"

    @property
    def work(self) -> float:
        """Amount of work: twins, seconds of traffic, rays of all frames."""
        return self.size * self.rays if self.kind == "dataset" else self.size


@dataclass(frozen=True)
class Outcome:
    """Outcome of a step.

    Attributes:
        notes: entry of the journal for a finished step.
        why: reason of a failure.
        attempts: number of attempts.
        no_room: whether it failed because the disk is full, as every later step would.
    """

    notes: Mapping[str, Any] = field(default_factory=dict)
    why: str | None = None
    attempts: int = 1
    no_room: bool = False


@dataclass(frozen=True)
class Plan:
    """Remaining work of an experiment, with its cost.

    Attributes:
        steps: number of remaining steps of each kind.
        frames: number of remaining frames.
        seconds: processor time, seconds.
        size: size, bytes.
        measured: number of steps of each kind with measured cost.
    """

    steps: dict[str, int]
    frames: int
    seconds: float
    size: float
    measured: dict[str, int]


class Pool(Protocol):
    """Workers that make steps, with the face of ``concurrent.futures``."""

    def submit(self, function: Callable[[Step], Outcome], step: Step, /) -> Future[Outcome]:
        """Begin a step."""
        ...


class Course:
    """Course of an experiment.

    Args:
        steps: steps by place, each after those that it needs.
        folder: the experiment's folder.
        storage: storage format of points.

    Attributes:
        steps: all steps.
        journal: entries of the steps, by place.
        state: state of each step: ``waiting``, ``running``, ``done``, ``failed``; ``dropped``, not
            begun because a required step failed; ``unneeded``, not required by a missing dataset.
        running: start times of the running steps, seconds of `time.monotonic`.
        failed: reasons of failed and dropped steps, by place.
        to_make: steps to run when the course began.
        frames: number of frames recorded by this run.
        began: start time, seconds of `time.monotonic`.
    """

    def __init__(self, steps: Mapping[str, Step], folder: Path, storage: str = "npy") -> None:
        self.steps = steps
        self.folder = folder
        self.journal = Journal(folder)
        self.state: dict[str, str] = {}
        self.running: dict[str, float] = {}
        self.failed: dict[str, str] = {}
        self.frames = 0
        self.began = time.monotonic()
        self._storage = storage
        self._dependants: dict[str, list[Step]] = {}
        self._lacks: dict[str, int] = {}
        self._ready: list[tuple[int, int, str]] = []
        self._order = {place: number for number, place in enumerate(steps)}
        self._crashes: Counter[str] = Counter()
        self.to_make = self._plan_steps()

    def _plan_steps(self) -> tuple[Step, ...]:
        """Find the steps to run: of twins and motions only those required by missing datasets."""
        for step in reversed(list(self.steps.values())):
            if self.journal.is_done(step.place, step.key, f"{step.kind}.json"):
                self.state[step.place] = "done"
            elif step.kind == "dataset" or step.place in self._dependants:
                self.state[step.place] = "waiting"
                for need in step.needs:
                    self._dependants.setdefault(need, []).append(step)
            else:
                self.state[step.place] = "unneeded"
        waiting = tuple(one for one in self.steps.values() if self.state[one.place] == "waiting")
        for step in waiting:
            self._lacks[step.place] = sum(self.state[need] == "waiting" for need in step.needs)
            if not self._lacks[step.place]:
                self._enqueue(step)
        return waiting

    def _enqueue(self, step: Step) -> None:
        # Datasets before the next motion, so that frames are available early.
        self.state[step.place] = "waiting"
        rank = len(KINDS) - KINDS.index(step.kind)
        heapq.heappush(self._ready, (rank, self._order[step.place], step.place))

    def of(self, kind: str) -> list[Step]:
        """Return the steps of a kind."""
        return [step for step in self.steps.values() if step.kind == kind]

    def counts(self, kind: str) -> Counter[str]:
        """Return the number of steps of a kind in each state."""
        return Counter(self.state[step.place] for step in self.of(kind))

    @property
    def left(self) -> int:
        """Number of steps that are neither finished nor given up."""
        return sum(state in ("waiting", "running") for state in self.state.values())

    def plan(self) -> Plan:
        """Return the remaining work and its estimated cost."""
        costs, left = self._costs(), [one for one in self.to_make if self._left(one)]
        return Plan(
            {kind: sum(one.kind == kind for one in left) for kind in KINDS},
            int(sum(one.size for one in left if one.kind == "dataset")),
            sum(one.work * costs[one.kind][0] for one in left),
            sum(one.work * costs[one.kind][1] for one in left),
            {kind: self.counts(kind)["done"] for kind in KINDS},
        )

    def share_done(self, under_way: Mapping[str, float]) -> float:
        """Return the fraction of this run's work that is done, weighted by cost.

        Args:
            under_way: fraction done of the running steps, by place.
        """
        costs = self._costs()
        total = done = 0.0
        for step in self.to_make:
            cost = step.work * costs[step.kind][0]
            total += cost
            done += cost * (under_way.get(step.place, 0.0) if self._left(step) else 1.0)
        return min(done / total, 1.0) if total else 1.0

    def _left(self, step: Step) -> bool:
        return self.state[step.place] not in _ENDED

    def _costs(self) -> dict[str, tuple[float, float]]:
        """Return seconds and bytes for a unit of work of each kind: measured, or estimated."""
        costs = {}
        for kind in KINDS:
            done = [one for one in self.of(kind) if self.state[one.place] == "done"]
            rows = [self.journal.row(one.place) for one in done]
            work = sum(one.work for one in done)
            seconds = sum(float(row.get("processor_s", 0.0)) for row in rows)
            size = sum(float(row.get("bytes", 0)) for row in rows)
            if work and seconds:
                costs[kind] = seconds / work, size / work
            else:
                each_s, each_bytes = _ESTIMATES[kind]
                costs[kind] = each_s, each_bytes * _PACKED[self._storage]
        return costs

    def run(
        self,
        pool: Pool,
        make: Callable[[Step], Outcome],
        *,
        abreast: int,
        tell: Callable[[Course], None],
        most: int | None = None,
    ) -> None:
        """Run all remaining steps.

        Args:
            pool: workers.
            make: function that runs a step without raising.
            abreast: number of parallel steps.
            tell: called at each change, and at least every second.
            most: largest number of datasets to begin; ``None`` for all.

        Raises:
            StageError: the disk is full.
            BrokenExecutor: a worker was killed; the next run repeats its step.
        """
        under_way: dict[Future[Outcome], Step] = {}
        try:
            while True:
                while self._ready and len(under_way) < abreast:
                    step = self.steps[self._ready[0][2]]
                    if step.kind == "dataset" and most is not None:
                        if most <= 0:
                            break
                        most -= 1
                    heapq.heappop(self._ready)
                    self.running[step.place] = time.monotonic()
                    self.state[step.place] = "running"
                    try:
                        under_way[pool.submit(make, step)] = step
                    except BrokenExecutor:  # before it began
                        del self.running[step.place]
                        self._enqueue(step)
                        raise
                    tell(self)
                if not under_way:
                    return
                ended, _ = wait(under_way, timeout=_TELL_EVERY_S, return_when=FIRST_COMPLETED)
                for future in ended:
                    try:
                        outcome = future.result()
                    except StageError as error:  # its machine was lost, several times
                        outcome = Outcome(why=str(error))
                    self._end(under_way.pop(future), outcome)
                tell(self)
        except BrokenExecutor:
            self._crashed(list(under_way.values()))
            raise
        finally:
            for step in under_way.values():
                self.running.pop(step.place, None)
                if self.state[step.place] == "running":
                    self.state[step.place] = "waiting"

    def _crashed(self, steps: Sequence[Step]) -> None:
        """Requeue steps lost with a killed worker, up to the limit of attempts."""
        for step in steps:
            self._crashes[step.place] += 1
            if self._crashes[step.place] < ATTEMPTS:
                self._enqueue(step)
            else:
                why = "a worker was killed (out of memory?); fewer workers need less"
                self._end(step, Outcome(why=why, attempts=ATTEMPTS))

    def _end(self, step: Step, outcome: Outcome) -> None:
        """Record the outcome of a step, and begin or drop the steps that depend on it."""
        place, why = step.place, outcome.why
        del self.running[place]
        if outcome.no_room:
            self._enqueue(step)
            raise StageError(str(why))
        row: dict[str, Any] = {"key": step.key, "attempts": outcome.attempts}
        if why is not None:
            self.state[place] = "failed"
            self.failed[place] = why
            self.journal.note(place, state="failed", **row, why=why)
            self._drop(step, why)
            return
        self.state[place] = "done"
        self.journal.note(place, state="done", **row, **outcome.notes)
        self.frames += int(outcome.notes.get("frames", 0))
        for after in self._dependants.get(place, ()):
            self._lacks[after.place] -= 1
            if not self._lacks[after.place]:
                self._enqueue(after)

    def _drop(self, step: Step, why: str) -> None:
        """Drop the steps that depend on a failed one."""
        for after in self._dependants.get(step.place, ()):
            if after.place not in self.failed:
                self.state[after.place] = "dropped"
                self.failed[after.place] = f"{step.place}: {why}"
                self._drop(after, why)
