"""Frames on processes of this machine or of a cluster; which of them changes nothing in it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from itertools import islice

import shapely

from urbantwin.cluster import Cluster, ClusterWorkers
from urbantwin.dataset.frame_motion import FrameMotion
from urbantwin.dataset.frame_place import FramePlace
from urbantwin.dataset.layout import frame_name, write_frame
from urbantwin.dataset.manifest_schema import pose_matrix
from urbantwin.dataset.motion_interpolation import posed_actors
from urbantwin.dataset.sweep_table import sweep_rows
from urbantwin.errors import StageError
from urbantwin.geometry import LabelledMesh, SurfaceMaterials
from urbantwin.lidar import Rig, Scanner
from urbantwin.processes import worker_pool
from urbantwin.traffic.assets import asset_mesh, mesh_among

__all__ = ["Part", "Recipe", "Task", "Workers", "record_frames"]

#: How many processes of this machine, or a cluster; ``None`` for as many as there are processors.
Workers = int | Cluster | None

#: What one worker has in hand besides what it works on: enough that it never waits.
_QUEUED = 3


@dataclass(frozen=True)
class Task:
    """One frame to record: of which part, its number, and the actors at its time and around it."""

    part: str
    index: int
    motion: FrameMotion


@dataclass(frozen=True, eq=False)
class Part:
    """What the frames of one dataset share.

    Attributes:
        rig: the sensors.
        seed: of all random numbers.
        place: where the files go, prepared for every folder of ``layout.folders_of``.
    """

    rig: Rig
    seed: int
    place: FramePlace


@dataclass(frozen=True, eq=False)
class Recipe:
    """What all frames share: those of one dataset, or of several in one world.

    Attributes:
        static: the static world, site frame.
        parts: of each dataset, by name.
        meshes: by asset and phase; what is not here comes from the catalogue.
        surface: materials of the ground that are finer than the static world's triangles.
        region: where labels count, site frame; everywhere when not given.
        backend: what casts the rays, see `lidar.Scanner`.
        storage: of points, see `layout.write_frame`.
    """

    static: LabelledMesh
    parts: Mapping[str, Part]
    meshes: Mapping[tuple[str, int], LabelledMesh] = field(default_factory=dict)
    surface: SurfaceMaterials | None = None
    region: shapely.Polygon | None = None
    backend: str = "embree"
    storage: str = "npy"


class _Recorder:
    """Records frames of one part after the other; the next one goes on with what both share."""

    def __init__(self, recipe: Recipe) -> None:
        self._recipe = recipe
        self._part = ""
        self._scanner: Scanner | None = None
        self._scanner = self._scanner_of(next(iter(recipe.parts)))

    def _scanner_of(self, part: str) -> Scanner:
        """Return the scanner of a part: what standing sensors see is kept of one part alone."""
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
            )
        return self._scanner

    def _mesh(self, asset: str, phase: int) -> LabelledMesh:
        return mesh_among(self._recipe.meshes, asset, phase, asset_mesh)

    def record(self, task: Task) -> int:
        part = self._recipe.parts[task.part]
        rig = part.rig
        actors = posed_actors(task.motion.rows, task.motion.paths())
        frame = self._scanner_of(task.part).scan(task.index, actors)
        entry = write_frame(part.place, task.index, frame, self._recipe.storage)
        carrier = next((one.way for one in actors if one.track == rig.carrier), None)
        entry["sweeps"] = sweep_rows(rig, task.index, part.seed, carrier)
        if carrier is not None:
            entry["dataset_SE3_site"] = pose_matrix(rig.dataset_pose(carrier))
        part.place.mark(frame_name(task.index), entry)
        return task.index


def record_frames(recipe: Recipe, tasks: Iterable[Task], workers: int | Cluster) -> Iterator[int]:
    """Record frames and yield the number of each when its files are there, in any order.

    Args:
        recipe: what all frames share.
        tasks: the frames, made when they are needed, those of a part together.
        workers: number of processes, or a cluster; with one, frames are recorded in this one.

    Raises:
        InputError: a worker does not see where the frames go.
        StageError: a worker was killed; on a cluster, a frame was lost with its worker many times.
    """
    places = [part.place for part in recipe.parts.values()]
    if isinstance(workers, Cluster):
        workers.on_every_node(_check_places, places)  # before any work, and of all nodes
        with workers.worker_pool(_start, recipe) as crew:
            yield from _recorded(crew, tasks, crew.room)
        return
    if workers == 1:
        recorder = _Recorder(recipe)
        yield from map(recorder.record, tasks)
        return
    try:
        with worker_pool(workers, _start, recipe) as pool:
            pool.submit(_check_places, places).result()
            yield from _recorded(pool, tasks, workers * _QUEUED)
    except BrokenProcessPool:
        raise StageError(
            "a worker was killed (out of memory?); what is finished is kept: "
            "give the same command again, with fewer workers"
        ) from None


def _recorded(pool: Executor | ClusterWorkers, tasks: Iterable[Task], most: int) -> Iterator[int]:
    """Yield the number of each frame that a pool recorded; it has so many in hand at most."""
    waiting = iter(tasks)
    under_way: set[Future[int]] = set()
    while True:
        room = most - len(under_way)
        under_way |= {pool.submit(_record, task) for task in islice(waiting, room)}
        if not under_way:
            return
        finished, under_way = wait(under_way, return_when=FIRST_COMPLETED)
        for future in finished:
            yield future.result()


_recorder: _Recorder | None = None


def _start(recipe: Recipe) -> None:
    global _recorder  # noqa: PLW0603 - a worker's only state: what its static rays hit
    _recorder = _Recorder(recipe)


def _check_places(places: Iterable[FramePlace]) -> None:
    for place in places:
        place.check()


def _record(task: Task) -> int:
    assert _recorder is not None
    return _recorder.record(task)
