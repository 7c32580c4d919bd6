"""Visibility of a motion from views: each is ray-traced once, and combined into layouts.

Points are those of `lidar.sight.expected_points`. Sensors do not interfere, so a layout's returns
from an actor are the sum over its views, without further ray tracing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import as_completed
from concurrent.futures.process import BrokenProcessPool, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import NamedTuple
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import StageError
from urbantwin.geometry import LabelledMesh, SurfaceMaterials
from urbantwin.lidar.actor_path import Paths
from urbantwin.lidar.beams import Beams
from urbantwin.lidar.casting.tracer import SensorPoses
from urbantwin.lidar.returns import ReturnModel
from urbantwin.lidar.rig import MountedSensor
from urbantwin.lidar.shapes import PresentActors, ShapeTable
from urbantwin.lidar.sight import LEVEL_M, ExpectedPoints, FieldOfView, LineOfSight
from urbantwin.lidar.sight.expected_points import NOBODY, Turn
from urbantwin.lidar.sight.junction import Stance, visible
from urbantwin.lidar.timing import sweeps_of
from urbantwin.processes import worker_pool
from urbantwin.site.rig import Conditions
from urbantwin.studies.placement.beam_voxels import Voxels, passed_voxels
from urbantwin.studies.placement.moments import Moments, Squares
from urbantwin.studies.placement.view import Layout, Views
from urbantwin.traffic.assets import asset_mesh, mesh_among
from urbantwin.traffic.assets.truck_parts import mesh_of_part

__all__ = [
    "NOBODY",
    "Caster",
    "Casts",
    "Recipe",
    "Sighting",
    "casts_in",
    "read_sighting",
    "write_sighting",
]

#: Returns within this of a square's height are of its ground, metres.
_ON_GROUND_M = 1.2


class Sighting(NamedTuple):
    """Visibility of the targets from a view.

    Attributes:
        points: (P,) float32, expected points on each target.
        alone: (P,) float32, expected points without occlusion.
        blocker: (P,) int32, main occluder: a track, or -1 minus a semantic class; `NOBODY` if none.
        taken: (P,) float32, number of points lost to it.
        range_m: (P,) float32, distance from the sensor to the centre of the box, metres.
        sees: (M,) bool, visible squares of the ground.
        ground: (M,) float32, expected points on each square.
        passed: (V,) bool, voxels crossed by beams.
    """

    points: NDArray[np.float32]
    alone: NDArray[np.float32]
    blocker: NDArray[np.int32]
    taken: NDArray[np.float32]
    range_m: NDArray[np.float32]
    sees: NDArray[np.bool_]
    ground: NDArray[np.float32]
    passed: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Recipe:
    """Data common to all views.

    Attributes:
        mesh: the static scene, site frame.
        surface: fine materials of the ground.
        meshes: meshes of actors, by asset and phase.
        moments: moments of the motion.
        squares: squares of the ground.
        voxels: voxels of the traffic.
        models: a sensor of each model.
        conditions: weather and sun.
        seed: random seed of the turns' timing.
    """

    mesh: LabelledMesh
    surface: SurfaceMaterials
    meshes: Mapping[tuple[str, int], LabelledMesh]
    moments: Moments
    squares: Squares
    voxels: Voxels
    models: tuple[MountedSensor, ...]
    conditions: Conditions
    seed: int


class Caster:
    """Ray-traces views one after the other; world and actors' shapes are built once.

    Args:
        recipe: data common to all views.
    """

    def __init__(self, recipe: Recipe) -> None:
        self._recipe = recipe
        middle = recipe.squares.ground.middle
        self._world = ExpectedPoints(recipe.mesh, recipe.surface, np.array([*middle, 0.0]))
        self._around = LineOfSight(recipe.mesh, middle)
        shapes = ShapeTable(partial(mesh_of_part, self._mesh))
        numbers = [
            np.array([shapes.number(one.asset, one.phase) for one in moment.actors], np.int64)
            for moment in recipe.moments.every
        ]
        self._present = [
            PresentActors(shapes.arrays, number, Paths.of([one.way for one in moment.actors]))
            for number, moment in zip(numbers, recipe.moments.every, strict=True)
        ]
        self._models: dict[int, tuple[Beams, ReturnModel, FieldOfView]] = {}

    def _mesh(self, asset: str, phase: int) -> LabelledMesh:
        return mesh_among(self._recipe.meshes, asset, phase, asset_mesh)

    def cast(self, mounted: MountedSensor, model: int, moments: int | None = None) -> Sighting:
        """Return the visibility from a sensor.

        Args:
            mounted: the sensor with its pose.
            model: index of its model.
            moments: number of moments to trace, to measure the time; all if not given.
        """
        recipe = self._recipe
        if model not in self._models:
            self._models[model] = (
                Beams.of(mounted),
                ReturnModel(mounted, recipe.conditions),
                FieldOfView.coarse(mounted.sensor, mounted.columns),
            )
        beams, answers, field = self._models[model]
        path = mounted.path(0, recipe.seed)
        poses = SensorPoses(*(np.array(one, order="C") for one in path.true_poses(np.zeros(1))))
        empty = self._world.turn(mounted, answers, beams, poses)
        targets = recipe.moments.targets
        points, alone, taken = (np.zeros(len(targets), np.float32) for _ in range(3))
        blocker = np.full(len(targets), NOBODY, np.int32)
        for number, moment in enumerate(recipe.moments.every[:moments]):
            rows = np.flatnonzero(targets.moment == number)
            actor = targets.actor[rows]
            tracks = np.array([one.track for one in moment.actors], np.int64)
            for sweep in sweeps_of(mounted, moment.index, recipe.seed):
                turn = empty
                if mounted.sensor.pattern is not None:  # The beams of every turn differ.
                    of_turn = Beams.of(mounted, sweep.turn)
                    turn = self._world.turn(mounted, answers, of_turn, poses)
                found = turn.on_actors(self._present[number], sweep) if len(rows) else None
                if found is None:
                    continue
                points[rows] += found.points[actor]
                alone[rows] += found.alone[actor]
                code, most = found.blocker[actor], found.taken[actor]
                more = most > taken[rows]
                code = np.where(code >= 0, tracks[np.maximum(code, 0)], code)
                blocker[rows[more]], taken[rows[more]] = code[more], most[more]
        away = np.linalg.norm(targets.middle - poses.translation[0], axis=1).astype(np.float32)
        ground, passed = self._ground(empty)
        squares = recipe.squares.ground
        sees = visible(Stance.of(mounted), squares, self._around, field)
        return Sighting(points, alone, blocker, taken, away, sees, ground, passed)

    def written(self, mounted: MountedSensor, model: int, path: Path) -> Sighting:
        """Return the visibility from a sensor, and write it to a file."""
        sighting = self.cast(mounted, model)
        write_sighting(path, sighting)
        return sighting

    def _ground(self, empty: Turn) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Return points on each square without traffic, and the voxels crossed by beams."""
        squares, found = self._recipe.squares.ground, empty.points
        number = squares.numbers(found.place[:, :2])
        on = np.flatnonzero(found.is_ground & (number >= 0))
        above = squares.points[number[on], 2] - LEVEL_M
        on = on[np.abs(found.place[on, 2] - above) < _ON_GROUND_M]
        ground = np.bincount(number[on], found.chance[on], minlength=len(squares.points))
        reach_m = np.full(len(empty.aims), empty.mounted.sensor.assumed_range_max_m)
        np.minimum.at(reach_m, found.beam, found.range_m)
        origin = empty.poses.translation[0]
        passed = passed_voxels(self._recipe.voxels, origin, empty.aims, reach_m)
        return ground.astype(np.float32), passed


def write_sighting(path: Path, sighting: Sighting) -> None:
    """Write the visibility of a view, atomically."""
    part = path.with_name(f".{path.name}.part")
    with part.open("wb") as stream:
        np.savez(stream, **sighting._asdict())
    part.replace(path)


def read_sighting(path: Path) -> Sighting | None:
    """Return the visibility of a view from a file; ``None`` if missing or incomplete."""
    try:
        with path.open("rb") as stream, np.load(stream) as found:
            return Sighting(*(found[name] for name in Sighting._fields))
    except (OSError, ValueError, KeyError, EOFError, BadZipFile):
        return None


@dataclass(eq=False)
class Casts:
    """What views see, ray-traced on first request.

    Attributes:
        views: all views.
        recipe: data common to all views.
        folder: folder of the stored results.
        here: caster of this process.
        pool: casting processes; ``None`` to cast in this process.
        made: number of views traced by this run.
    """

    views: Views
    recipe: Recipe
    folder: Path
    here: Caster
    pool: ProcessPoolExecutor | None = None
    made: int = 0
    _known: dict[int, Sighting] = field(default_factory=dict)

    def of(self, layout: Layout) -> list[Sighting]:
        """Return what each view of a layout sees."""
        self.ensure(layout)
        return [self._known[number] for number in layout]

    def ensure(
        self, numbers: Sequence[int], tell: Callable[[int, int], None] | None = None
    ) -> None:
        """Trace the views that are not known yet.

        Args:
            numbers: indices of the views.
            tell: called with the numbers of traced views and of all views to trace.

        Raises:
            StageError: a worker was killed.
        """
        missing = []
        for number in dict.fromkeys(numbers):
            if number in self._known:
                continue
            kept = read_sighting(self.path(number))
            if kept is None:
                missing.append(number)
            else:
                self._known[number] = kept
        for count, (number, sighting) in enumerate(self._cast(missing), 1):
            self._known[number] = sighting
            self.made += 1
            if tell is not None:
                tell(count, len(missing))

    def path(self, number: int) -> Path:
        """Return the file of a view."""
        return self.folder / f"view-{number:06d}.npz"

    def _cast(self, numbers: Sequence[int]) -> Iterator[tuple[int, Sighting]]:
        tasks = {
            number: (
                self.views.hung(number, self.recipe.models),
                self.views.every[number].model,
                self.path(number),
            )
            for number in numbers
        }
        if self.pool is None:
            for number, task in tasks.items():
                yield number, self.here.written(*task)
            return
        try:
            waiting = {self.pool.submit(_cast, *task): number for number, task in tasks.items()}
            for one in as_completed(waiting):
                yield waiting[one], one.result()
        except BrokenProcessPool:
            raise StageError(
                "a worker was killed (out of memory?); what was cast is kept: "
                "give the same command again, with fewer workers"
            ) from None


@contextmanager
def casts_in(folder: Path, views: Views, recipe: Recipe, workers: int) -> Iterator[Casts]:
    """Yield the results of views, with the processes that trace them."""
    folder.mkdir(parents=True, exist_ok=True)
    here = Caster(recipe)
    if workers == 1:
        yield Casts(views, recipe, folder, here)
        return
    with worker_pool(workers, _start, recipe) as pool:
        yield Casts(views, recipe, folder, here, pool)


_caster: Caster | None = None


def _start(recipe: Recipe) -> None:
    global _caster  # noqa: PLW0603 - a worker's only state: the world and the actors' shapes
    _caster = Caster(recipe)


def _cast(mounted: MountedSensor, model: int, path: Path) -> Sighting:
    assert _caster is not None
    return _caster.written(mounted, model, path)
