"""What one view sees of a motion: its beams are cast once, and combined into any layout.

Sensors do not take each other's points away: what a layout's sensors return from an actor is the
sum of what each returns alone. So a layout costs no casting of its own. Beams are those of the
sensor's model as it hangs there, each at its own firing time, with their footprints, panes of glass
and the chance of a return (`lidar.echoes.combined`): what `urbantwin record` draws from, before
anything is drawn.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import LabelledMesh, SurfaceMaterials, ypr_from_rotation
from urbantwin.lidar.actor_path import Paths
from urbantwin.lidar.beams import Beams
from urbantwin.lidar.casting.backend import tracer_on
from urbantwin.lidar.casting.cast import cast_actors
from urbantwin.lidar.casting.tracer import Firing, Layers, SensorPoses
from urbantwin.lidar.compiled.echoes import BESIDE
from urbantwin.lidar.echoes import Alone, Echoes, combined, static_echoes
from urbantwin.lidar.returns import LEVELS, ReturnModel
from urbantwin.lidar.rig import MountedSensor
from urbantwin.lidar.shapes import PresentActors, ShapeTable
from urbantwin.lidar.siting.field_of_view import FieldOfView
from urbantwin.lidar.siting.surroundings import Surroundings
from urbantwin.lidar.siting.viewpoint import Stance, judged
from urbantwin.lidar.static_world import StaticLayers, World
from urbantwin.lidar.sweep import Sweep
from urbantwin.lidar.timing import sweeps_of
from urbantwin.site.rig import Conditions
from urbantwin.studies.placement.beam_voxels import Voxels, passed_voxels
from urbantwin.studies.placement.moments import Moment, Moments, Squares
from urbantwin.taxonomy import GROUND_CLASSES, semantic_id
from urbantwin.traffic.assets import asset_mesh, mesh_among
from urbantwin.traffic.assets.truck_parts import mesh_of_part

__all__ = ["NOBODY", "Caster", "Recipe", "Sighting", "read_sighting", "write_sighting"]

#: Where nothing hides an actor.
NOBODY = -(1 << 30)
#: Returns within this of a square's height are of its ground, metres.
_ON_GROUND_M = 0.6


class Sighting(NamedTuple):
    """What one view sees.

    Attributes:
        points: (P,) float32, points expected on each target.
        alone: (P,) float32, points that it would give if nothing stood before it.
        blocker: (P,) int32, what takes most of the others: a track, or -1 less a semantic class;
            `NOBODY` where nothing does.
        taken: (P,) float32, how many that takes.
        range_m: (P,) float32, from the sensor to the middle of its box.
        sees: (M,) bool, squares of the ground in sight.
        ground: (M,) float32, points expected on each square.
        passed: (V,) bool, voxels that beams pass.
    """

    points: NDArray[np.float32]
    alone: NDArray[np.float32]
    blocker: NDArray[np.int32]
    taken: NDArray[np.float32]
    range_m: NDArray[np.float32]
    sees: NDArray[np.bool_]
    ground: NDArray[np.float32]
    passed: NDArray[np.bool_]


class Returned(NamedTuple):
    """What a view returns of P targets: the first four of `Sighting`."""

    points: NDArray[np.float32]
    alone: NDArray[np.float32]
    blocker: NDArray[np.int32]
    taken: NDArray[np.float32]

    @classmethod
    def room(cls, count: int) -> Returned:
        """Return what nobody returned anything of."""
        return cls(
            np.zeros(count, np.float32),
            np.zeros(count, np.float32),
            np.full(count, NOBODY, np.int32),
            np.zeros(count, np.float32),
        )


@dataclass(frozen=True, eq=False)
class Recipe:
    """What all views share.

    Attributes:
        mesh: the static world, site frame.
        surface: materials of the ground that are finer than it.
        meshes: of actors, by asset and phase.
        moments: of the motion.
        squares: of the ground.
        voxels: of the traffic.
        models: a sensor of each model.
        conditions: weather and sun.
        seed: of the turns' timing.
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
    """Casts views, one after the other; the world and the actors' shapes are made once.

    Args:
        recipe: what all views share.
    """

    def __init__(self, recipe: Recipe) -> None:
        self._recipe = recipe
        self._tracer = tracer_on()
        middle = np.array([*recipe.squares.ground.middle, 0.0])
        self._world = World(recipe.mesh, middle, recipe.surface, self._tracer)
        self._around = Surroundings(recipe.mesh, recipe.squares.ground.middle)
        shapes = ShapeTable(partial(mesh_of_part, self._mesh))
        numbers = [
            np.array([shapes.number(one.asset, one.phase) for one in moment.actors], np.int64)
            for moment in recipe.moments.every
        ]
        self._present = [
            PresentActors(shapes.arrays, number, Paths.of([one.way for one in moment.actors]))
            for number, moment in zip(numbers, recipe.moments.every, strict=True)
        ]
        self._beams: dict[int, tuple[Beams, ReturnModel, FieldOfView]] = {}
        targets = recipe.moments.targets
        self._rows = [np.flatnonzero(targets.moment == k) for k in range(len(recipe.moments.every))]

    def _mesh(self, asset: str, phase: int) -> LabelledMesh:
        return mesh_among(self._recipe.meshes, asset, phase, asset_mesh)

    def cast(self, mounted: MountedSensor, model: int, moments: int | None = None) -> Sighting:
        """Return what a sensor sees.

        Args:
            mounted: the sensor, where it hangs.
            model: number of its model.
            moments: so many alone, to see how long one takes.
        """
        recipe = self._recipe
        beams, answers, field = self._of_model(mounted, model)
        path = mounted.path(0, recipe.seed)
        poses = SensorPoses(*(np.array(one, order="C") for one in path.true_poses(np.zeros(1))))
        targets = recipe.moments.targets
        found = Returned.room(len(targets))
        static = None
        for moment, present, rows in list(
            zip(recipe.moments.every, self._present, self._rows, strict=True)
        )[:moments]:
            for sweep in sweeps_of(mounted, moment.index, recipe.seed):
                turn = beams or Beams.of(mounted, sweep.turn)
                if static is None or beams is None:
                    static = self._static(turn, poses, answers)
                met = cast_actors(
                    self._tracer,
                    turn,
                    Firing.of(turn, sweep, poses),
                    present,
                    mounted.sensor.assumed_range_max_m,
                    glass=mounted.effects.glass,
                )
                self._add(found, rows, static, present, met, turn, answers, mounted)
        place = poses.translation[0]
        away = np.linalg.norm(targets.middle - place, axis=1).astype(np.float32)
        ground, passed = self._ground(mounted, beams, poses, answers, static)
        points, alone, blocker, taken = found
        sees = self._sees(mounted, field)
        return Sighting(points, alone, blocker, taken, away, sees, ground, passed)

    def _of_model(
        self, mounted: MountedSensor, model: int
    ) -> tuple[Beams | None, ReturnModel, FieldOfView]:
        """Return beams (``None``: others in every turn), answers and field of view of a model."""
        if model not in self._beams:
            self._beams[model] = (
                Beams.of(mounted),
                ReturnModel(mounted, self._recipe.conditions),
                FieldOfView.of_sensor(mounted.sensor, mounted.columns),
            )
        beams, answers, field = self._beams[model]
        return (beams if mounted.sensor.pattern is None else None), answers, field

    def _static(self, beams: Beams, poses: SensorPoses, answers: ReturnModel) -> StaticLayers:
        sweep = Sweep.snapshot(beams.columns, beams.channels)
        return self._world.layers(beams, sweep, poses, answers, thorough=True)

    def _add(
        self,
        found: Returned,
        rows: NDArray[np.int64],
        static: StaticLayers,
        present: PresentActors,
        met: Layers,
        beams: Beams,
        answers: ReturnModel,
        mounted: MountedSensor,
    ) -> None:
        """Add what a turn returns of a moment's targets."""
        if not len(rows) or not len(met.ray):
            return
        points, alone, blocker, taken = found
        share = beams.footprint.share
        echoes, lone = combined(static, present, met, share, answers, mounted.returns)
        kept = 1.0 - mounted.missing
        count = len(present.shape)
        actor = self._recipe.moments.targets.actor[rows]
        points[rows] += (kept * _returns(echoes, count, mounted.returns == "dual"))[actor]
        chance = lone.level / LEVELS
        own = np.bincount(lone.actor, chance, minlength=count)
        alone[rows] += (kept * own)[actor]
        who, most = _hidden_by(echoes, lone, static, count)
        tracks = np.array([one.track for one in self._moment_of(rows).actors], np.int64)
        other = np.where(who >= 0, tracks[np.maximum(who, 0)], who)
        more = kept * most[actor] > taken[rows]
        blocker[rows[more]] = other[actor[more]]
        taken[rows[more]] = (kept * most)[actor[more]]

    def _moment_of(self, rows: NDArray[np.int64]) -> Moment:
        return self._recipe.moments.every[int(self._recipe.moments.targets.moment[rows[0]])]

    def _sees(self, mounted: MountedSensor, field: FieldOfView) -> NDArray[np.bool_]:
        ground = self._recipe.squares.ground
        if not len(ground.points):
            return np.zeros(0, np.bool_)
        pose = mounted.site_SE3_sensor
        yaw, pitch, roll = (float(x) for x in ypr_from_rotation(pose.rotation))
        stance = Stance(pose.translation, mounted.sway_height_m, yaw, pitch, roll)
        return judged(stance, ground, self._around, field).sees

    def _ground(
        self,
        mounted: MountedSensor,
        beams: Beams | None,
        poses: SensorPoses,
        answers: ReturnModel,
        static: StaticLayers | None,
    ) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Return points on each square without traffic, and the voxels that are passed."""
        squares = self._recipe.squares
        if beams is None or static is None:
            beams = Beams.of(mounted)
            static = self._static(beams, poses, answers)
        share = beams.footprint.share
        echoes = static_echoes(static, share, answers, mounted.returns)
        aims = beams.directions @ poses.rotation[0].T
        first = echoes.first
        has = np.flatnonzero(first >= 0)
        beam, echo = echoes.beam[has], first[has]
        reach = np.full(len(aims), mounted.sensor.assumed_range_max_m)
        reach[beam] = echoes.range_m[echo]
        places = poses.translation[0] + aims[beam] * echoes.range_m[echo, None]
        walked = [semantic_id(name) for name in GROUND_CLASSES]
        on = np.isin(static.semantic[-1 - echoes.owner[echo]], walked)
        number = squares.numbers(places[on, :2])
        chance = echoes.level[echo[on]] / LEVELS
        points = squares.ground.points
        near = number >= 0
        near[near] = np.abs(places[on][near, 2] - points[number[near], 2] + 1.0) < 2 * _ON_GROUND_M
        ground = np.bincount(number[near], chance[near], minlength=len(points))
        passed = passed_voxels(self._recipe.voxels, poses.translation[0], aims, reach)
        return ground.astype(np.float32), passed


def _returns(echoes: Echoes, count: int, dual: bool) -> NDArray[np.float64]:
    """Return the points expected of each actor (A,)."""
    total = np.zeros(count)
    chance = echoes.level / LEVELS
    before = np.zeros(len(echoes.beam))
    for which in (echoes.first, echoes.second):
        beam = np.flatnonzero(which >= 0)
        echo = which[beam]
        own = (echoes.owner[echo] >= 0) & (echoes.owner[echo] < BESIDE)
        # A second echo is reported besides, or where the first was missed.
        weight = chance[echo] * (1.0 if dual else 1.0 - before[beam])
        total += np.bincount(echoes.owner[echo[own]], weight[own], minlength=count)
        before[beam] = chance[echo]
    return total


def _hidden_by(
    echoes: Echoes, alone: Alone, static: StaticLayers, count: int
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return what takes most returns from each actor (A,), and how many.

    An actor's number, or -1 less a semantic class, or `NOBODY`.
    """
    who, most = np.full(count, NOBODY, np.int64), np.zeros(count)
    place = echoes.place[alone.beam]
    first = np.where(place >= 0, echoes.first[np.maximum(place, 0)], -1)
    owner = echoes.owner[np.maximum(first, 0)].astype(np.int64)
    lost = (first >= 0) & ((owner < 0) | (owner % BESIDE != alone.actor))
    if not lost.any():
        return who, most
    owner, actor = owner[lost], alone.actor[lost].astype(np.int64)
    chance = alone.level[lost] / LEVELS
    semantic = static.semantic[-1 - np.minimum(owner, -1)].astype(np.int64)
    code = np.where(owner >= 0, owner % BESIDE, -1 - semantic)
    pairs, which = np.unique(np.stack([actor, code]), axis=1, return_inverse=True)
    sums = np.bincount(which.ravel(), chance, minlength=pairs.shape[1])
    for (one, blocker), taken in zip(pairs.T.tolist(), sums.tolist(), strict=True):
        if taken > most[one]:
            who[one], most[one] = blocker, taken
    return who, most


def write_sighting(path: Path, sighting: Sighting) -> None:
    """Write what a view sees; the file is whole or not there."""
    part = path.with_name(f".{path.name}.part")
    with part.open("wb") as stream:
        np.savez(stream, **sighting._asdict())
    part.replace(path)


def read_sighting(path: Path) -> Sighting | None:
    """Read what a view sees; ``None`` where an interrupted run did not come so far."""
    try:
        with path.open("rb") as stream, np.load(stream) as found:
            return Sighting(*(found[name] for name in Sighting._fields))
    except (OSError, ValueError, KeyError, EOFError, BadZipFile):
        return None
