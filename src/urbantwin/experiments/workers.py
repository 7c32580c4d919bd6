"""Workers that make the steps of an experiment: this process, a local pool, or a Ray cluster."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, Future
from contextlib import AbstractContextManager, contextmanager, suppress
from multiprocessing import active_children
from pathlib import Path
from typing import Any, Protocol

from urbantwin.errors import InputError, NoRoomError, TooLittleRoomError
from urbantwin.experiments.course import Course, Outcome, Pool, Step
from urbantwin.experiments.journal import ATTEMPTS
from urbantwin.progress import Progress

__all__ = [
    "RUNNING",
    "Maker",
    "Serial",
    "attempted",
    "local_pool",
    "make",
    "run_here",
    "run_on_cluster",
    "under_way",
]

Tell = Callable[[Course], None]

#: Subfolder of an experiment with progress files of the running steps.
RUNNING = "journal/running"
#: Shortest time between updates of such a file, seconds.
_NOTE_EVERY_S = 1.0


class Maker(Protocol):
    """Runs the steps of an experiment; pickled for the workers."""

    def made(self, step: Step, workers: int, tell: Progress) -> Mapping[str, Any]:
        """Run a step with a number of processes; return its entry of the journal."""
        ...


class Serial:
    """A pool that runs submitted calls at once in this process."""

    def submit(self, function: Callable[[Step], Outcome], step: Step, /) -> Future[Outcome]:
        """Do a step."""
        future: Future[Outcome] = Future()
        try:
            future.set_result(function(step))
        except BrokenExecutor as error:
            future.set_exception(error)
        return future


def attempted(
    maker: Maker,
    folder: Path,
    step: Step,
    workers: int = 1,
    watch: Callable[[], None] | None = None,
) -> Outcome:
    """Run a step, again if it fails; failures are returned, not raised.

    Args:
        maker: runs the step.
        folder: the experiment's folder.
        step: the step.
        workers: number of processes.
        watch: called regularly during the step.
    """
    attempt, why = 0, ""
    while attempt < ATTEMPTS:
        attempt += 1
        began, worked_s = time.monotonic(), _processor_s()
        try:
            with _progress_file(folder / RUNNING / f"{step.kind}-{step.name}", watch) as tell:
                notes = maker.made(step, workers, tell)
        except (NoRoomError, TooLittleRoomError) as error:
            return Outcome(why=str(error), attempts=attempt, no_room=True)
        except InputError as error:  # which another attempt does not change
            return Outcome(why=str(error), attempts=attempt)
        except Exception as error:  # a failed cell must not end the others
            why = str(error) or type(error).__name__
            continue
        took = {
            "size": step.size,
            "seconds": round(time.monotonic() - began, 3),
            "processor_s": round(_processor_s() - worked_s, 3),
        }
        return Outcome({**notes, **took}, attempts=attempt)
    return Outcome(why=why, attempts=attempt)


def run_here(course: Course, maker: Maker, workers: int, most: int | None, tell: Tell) -> None:
    """Run the remaining steps on this machine: cells in parallel, or frames if there are few cells.

    Args:
        course: course of the experiment.
        maker: runs the steps.
        workers: number of processes.
        most: largest number of datasets; ``None`` for all.
        tell: called with the course at each change.
    """
    cells = sum(step.kind == "dataset" for step in course.to_make)
    if workers == 1 or (cells if most is None else min(cells, most)) < workers:
        course.run(
            Serial(),
            lambda step: attempted(maker, course.folder, step, workers, lambda: tell(course)),
            abreast=1, tell=tell, most=most,
        )  # fmt: skip
        return
    while True:
        begun = course.counts("dataset")["done"]
        try:
            with local_pool(maker, course.folder, workers) as pool:
                course.run(pool, make, abreast=workers, tell=tell, most=most)
            return
        except BrokenExecutor:  # a worker was killed: its step is repeated
            if most is not None:
                most -= course.counts("dataset")["done"] - begun


def run_on_cluster(
    course: Course,
    maker: Maker,
    ray: str,
    shared: Sequence[Path],
    workers: int | None,
    most: int | None,
    shown: Callable[[int], AbstractContextManager[Tell]],
) -> None:
    """Run the remaining steps on the nodes of a Ray cluster.

    Args:
        course: course of the experiment, whose folder is shared by all nodes.
        maker: runs the steps.
        ray: address of the cluster.
        shared: files that every node must have.
        workers: largest number of parallel steps; all processors for ``None``.
        most: see `run_here`.
        shown: shows the course, given the number of parallel steps.
    """
    from urbantwin.cluster import connected
    from urbantwin.dataset.manifest import versions_here

    with connected(ray, agreed=versions_here, workers=workers) as cluster:
        cluster.on_every_node(_check_seen, [course.folder / "journal", *shared])
        with cluster.worker_pool(_begin, maker, course.folder) as pool, shown(pool.workers) as tell:
            course.run(pool, make, abreast=pool.workers, tell=tell, most=most)


@contextmanager
def local_pool(maker: Maker, folder: Path, workers: int) -> Iterator[Pool]:
    """Yield a pool of processes that make steps; if the block fails, they end at once."""
    from urbantwin.processes import worker_pool

    before = set(active_children())
    with worker_pool(workers, _begin, maker, folder) as pool:
        try:
            yield pool
        except BaseException:
            # A cell may take an hour; its recorded frames are kept for the next run.
            for worker in set(active_children()) - before:
                worker.terminate()
            raise


#: The worker's only state: maker and folder of the experiment.
_worker: tuple[Maker, Path] | None = None


def _begin(maker: Maker, folder: Path) -> None:
    """Initialise a worker."""
    global _worker  # noqa: PLW0603
    _worker = maker, folder


def make(step: Step) -> Outcome:
    """Run a step in a worker; on SIGTERM remove partial output, and end the worker."""
    from urbantwin.interruption import EXIT_CODE, Interruptions, unwinds

    assert _worker is not None
    interruptions = Interruptions()
    try:
        with unwinds() as interruptions:
            return attempted(*_worker, step)
    finally:
        # Nothing else ends this worker if the pool's other workers have already ended.
        if interruptions.count:
            os._exit(EXIT_CODE)


def under_way(course: Course, place: str) -> tuple[float, str]:
    """Return the fraction done and the description of a running step."""
    kind, _, name = place.partition("s/")
    share, doing = 0.0, ""
    with suppress(OSError, ValueError):
        text = (course.folder / RUNNING / f"{kind}-{name}").read_text(encoding="utf-8")
        share = float(text.partition(" ")[0])
        doing = text.partition(" ")[2]
    return min(max(share, 0.0), 1.0), doing


def _check_seen(files: Sequence[Path]) -> None:
    """Check that this machine has access to files."""
    for file in files:
        if not file.exists():
            raise InputError(
                "is not seen from there", file=file, expected="a folder that every node sees"
            )


def _processor_s() -> float:
    """Return the time of processors that this process and its children took, seconds."""
    import resource  # not on Windows

    return sum(
        used.ru_utime + used.ru_stime
        for used in map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    )


@contextmanager
def _progress_file(file: Path, watch: Callable[[], None] | None) -> Iterator[Progress]:
    """Yield a progress callback that writes a file, which is removed at the end."""
    noted_s = 0.0

    def tell(share: float, doing: str) -> None:
        nonlocal noted_s
        now = time.monotonic()
        if now - noted_s < _NOTE_EVERY_S:
            return
        noted_s = now
        file.parent.mkdir(parents=True, exist_ok=True)
        part = file.with_name(f".{file.name}")
        part.write_text(f"{share:.4f} {doing}", encoding="utf-8")
        part.replace(file)
        if watch is not None:
            watch()

    try:
        yield tell
    finally:
        file.unlink(missing_ok=True)
