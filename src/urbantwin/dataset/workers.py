"""Recording of frames on processes of this machine or of a cluster; the result is the same."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from dataclasses import dataclass, field
from itertools import islice

import shapely

from urbantwin.cluster import Cluster
from urbantwin.dataset.frame_motion import FrameMotion
from urbantwin.dataset.frame_place import FramePlace
from urbantwin.dataset.layout import frame_name, write_frame
from urbantwin.dataset.motion_interpolation import posed_actors
from urbantwin.dataset.reading.manifest import pose_matrix
from urbantwin.dataset.sweep_table import sweep_rows
from urbantwin.errors import StageError
from urbantwin.geometry import LabelledMesh, SurfaceMaterials
from urbantwin.lidar import LabelledFrame, PosedActor, Rig, Scanner
from urbantwin.lidar.static_view import StaticView
from urbantwin.processes import (
    Helpers,
    handed,
    over,
    received,
    settle,
)
from urbantwin.traffic.assets import asset_mesh, mesh_among

__all__ = ["Part", "Recipe", "Task", "Workers", "record_frames"]

#: Number of processes of this machine, this one and its helpers, or a cluster; ``None`` for one per
#: processor.
Workers = int | Helpers | Cluster | None

#: Tasks queued per worker, so that it never waits.
_QUEUED = 2
#: Most frames per batch of a worker, and the largest duration of a batch, seconds: the last frame
#: is written while nothing is scanned, and a worker finishes its batch before it stops.
_LONGEST_RUN, _RUN_S = 16, 0.5


@dataclass(frozen=True)
class Task:
    """One frame to record: part, number, and the actors around its time."""

    part: str
    index: int
    motion: FrameMotion


@dataclass(frozen=True, eq=False)
class Part:
    """Common data of one dataset's frames.

    Attributes:
        rig: the sensors.
        seed: random seed.
        place: place of the files, prepared for every folder of ``layout.folders_of``.
    """

    rig: Rig
    seed: int
    place: FramePlace


@dataclass(frozen=True, eq=False)
class Recipe:
    """Common data of all frames, of one dataset or of several in one world.

    Attributes:
        static: the static world, site frame.
        parts: the datasets, by name.
        meshes: meshes by asset and phase; others come from the catalogue.
        surface: materials of the ground at finer resolution than the static world's triangles.
        region: area where labels count, site frame; everywhere if not given.
        backend: ray tracer, see `lidar.Scanner`.
        storage: format of points, see `layout.write_frame`.
    """

    static: LabelledMesh
    parts: Mapping[str, Part]
    meshes: Mapping[tuple[str, int], LabelledMesh] = field(default_factory=dict)
    surface: SurfaceMaterials | None = None
    region: shapely.Polygon | None = None
    backend: str | None = None
    storage: str = "npy"


class _Recorder:
    """Records frames of one part after the other; the next part reuses what both share.

    Attributes:
        frame_s: duration of the last scan, seconds.
    """

    def __init__(self, recipe: Recipe, standing: Sequence[StaticView | None] | None = None) -> None:
        """Look at the static world, where another recorder has not: see `standing`."""
        self._recipe = recipe
        self._part = ""
        self._writer = ThreadPoolExecutor(1)
        self._written: Future[int] | None = None
        self.frame_s = float("inf")
        self._scanner: Scanner | None = None
        self._scanner = self._scanner_of(next(iter(recipe.parts)), standing)

    @property
    def standing(self) -> list[StaticView | None]:
        """Static views of the fixed sensors of the current part."""
        assert self._scanner is not None
        return self._scanner.standing

    def _scanner_of(
        self, part: str, standing: Sequence[StaticView | None] | None = None
    ) -> Scanner:
        """Return the scanner of a part: static views are kept of one part only."""
        if self._scanner is None or part != self._part:
            recipe, own = self._recipe, self._recipe.parts[part]
            self._part = part
            self._scanner = Scanner(
                recipe.static,
                own.rig,
                own.seed,
                meshes=self._mesh,
                surface=recipe.surface,
                region=recipe.region,
                backend=recipe.backend,
                beside=self._scanner,
                standing=standing,
            )
        return self._scanner

    def _mesh(self, asset: str, phase: int) -> LabelledMesh:
        return mesh_among(self._recipe.meshes, asset, phase, asset_mesh)

    def recorded(self, tasks: Iterable[Task]) -> Iterator[int]:
        """Record frames and yield the number of each that is there, from the one before them on.

        One is written while the next is scanned; the last is there after `finished`.
        """
        for task in tasks:
            began = time.perf_counter()
            actors = posed_actors(task.motion.rows, task.motion.paths())
            frame = self._scanner_of(task.part).scan(task.index, actors)
            self.frame_s = time.perf_counter() - began
            yield from self.finished()
            self._written = self._writer.submit(self._write, task, frame, actors)

    def finished(self) -> Iterator[int]:
        """Wait for the frame that is being written and yield its number, if there is one."""
        if self._written is not None:
            written, self._written = self._written, None
            yield written.result()

    def close(self) -> None:
        """Wait for what is being written; nothing is recorded afterwards."""
        self._writer.shutdown()

    def _write(self, task: Task, frame: LabelledFrame, actors: Sequence[PosedActor]) -> int:
        part = self._recipe.parts[task.part]
        rig = part.rig
        entry = write_frame(part.place, task.index, frame, self._recipe.storage)
        carrier = next((one.way for one in actors if one.track == rig.carrier), None)
        entry["sweeps"] = sweep_rows(rig, task.index, part.seed, carrier)
        if carrier is not None:
            entry["dataset_SE3_site"] = pose_matrix(rig.dataset_pose(carrier))
        part.place.mark(frame_name(task.index), entry)
        return task.index


def record_frames(
    recipe: Recipe, tasks: Iterable[Task], count: int, workers: Helpers | Cluster
) -> Iterator[int]:
    """Record frames and yield the number of each when its files are there, in any order.

    Args:
        recipe: what all frames share.
        tasks: the frames, made when they are needed, those of a part together.
        count: how many they are.
        workers: this process and its helpers, or a cluster.

    Raises:
        InputError: a worker does not see where the frames go.
        StageError: a worker was killed; on a cluster, a frame was lost with its worker many times.
    """
    places = [part.place for part in recipe.parts.values()]
    if isinstance(workers, Cluster):
        workers.on_every_node(_check_places, places)  # before any work, and of all nodes
        with workers.worker_pool(_start, recipe) as crew:
            runs = _runs(tasks, count, crew.workers)
            yield from _recorded(lambda run: crew.submit(_record, run), runs, crew.room)
        return
    pool = workers.pool
    if pool is None or count == 1:
        with closing(_Recorder(recipe)) as own:
            yield from own.recorded(tasks)
            yield from own.finished()
        return
    try:
        checked = pool.submit(_check_places, places)
        # What this process has looked at the others, which were still starting, need not.
        with closing(_Recorder(recipe)) as own, handed((recipe, own.standing)) as place:
            recording = next(_recordings), place
            runs = _runs(tasks, count, workers.workers, lambda: int(_RUN_S / own.frame_s))
            room = (workers.workers - 1) * _QUEUED
            yield from _recorded(
                lambda run: pool.submit(_record_of, recording, run), runs, room, own, checked
            )
    except BrokenProcessPool:
        raise StageError(
            "a worker was killed (out of memory?); what is finished is kept: "
            "give the same command again, with fewer workers"
        ) from None


def _recorded(
    submit: Callable[[list[Task]], Future[list[int]]],
    runs: Iterator[list[Task]],
    most: int,
    own: _Recorder | None = None,
    checked: Future[list[int]] | None = None,
) -> Iterator[int]:
    """Yield the number of each frame that workers recorded.

    Args:
        submit: hands a run to them.
        runs: of frames.
        most: of them they have in hand at most.
        own: what this process records runs with while they work; it only waits when not given.
        checked: what they were asked before; they may still be starting.
    """
    under_way: set[Future[list[int]]] = set() if checked is None else {checked}
    most += len(under_way)
    try:
        while True:
            for run in islice(runs, most - len(under_way)):
                under_way.add(submit(run))
            mine = None if own is None else next(runs, None)
            if own is not None and mine is not None:
                yield from own.recorded(mine)
                finished, under_way = wait(under_way, timeout=0)
            else:
                if own is not None:
                    yield from own.finished()
                if not under_way:
                    return
                if own is None:
                    finished, under_way = wait(under_way, return_when=FIRST_COMPLETED)
                elif finished := over(under_way):
                    under_way -= finished
                else:
                    raise BrokenProcessPool
            for future in finished:
                yield from future.result()
    finally:
        if own is not None:  # helpers outlive this, and the folder may be another run's then
            settle(under_way)


def _runs(
    tasks: Iterable[Task], count: int, workers: int, longest: Callable[[], int] | None = None
) -> Iterator[list[Task]]:
    """Yield so many tasks in runs: single ones at first and at last, that all have some to do.

    Args:
        tasks: the frames.
        count: how many they are.
        workers: number of workers that record them.
        longest: says how many frames are a run at most, besides `_LONGEST_RUN`.
    """
    waiting = iter(tasks)
    for number in itertools.count():
        most = min(1 + number // (2 * workers), _LONGEST_RUN, count // ((1 + _QUEUED) * workers))
        if longest is not None and most > 1:
            most = min(most, longest())
        run = list(islice(waiting, max(most, 1)))
        if not run:
            return
        count -= len(run)
        yield run


#: Numbers of what this process has recorded with helpers: places of memory are used again.
_recordings = itertools.count()
_recorder: _Recorder | None = None
_recorder_of: int | None = None


def _start(recipe: Recipe, standing: Sequence[StaticView | None] | None = None) -> None:
    global _recorder  # noqa: PLW0603 - a worker's only state: what its static rays hit
    _recorder = _Recorder(recipe, standing)


def _check_places(places: Iterable[FramePlace]) -> list[int]:
    """Refuse places that this process does not see; it has recorded nothing of them yet."""
    for place in places:
        place.check()
    return []


def _record(run: list[Task]) -> list[int]:
    assert _recorder is not None
    return [*_recorder.recorded(run), *_recorder.finished()]


def _record_of(recording: tuple[int, str], run: list[Task]) -> list[int]:
    """Record frames of a recording: its number, and where its recipe is handed to helpers."""
    global _recorder_of  # noqa: PLW0603
    number, place = recording
    if number != _recorder_of:
        _start(*received(place))
        _recorder_of = number
    return _record(run)
