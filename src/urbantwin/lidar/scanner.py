"""One labelled frame of a rig: a pure function of the world, the seed and the frame's number."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.geometry import LabelledMesh, Pose, SurfaceMaterials
from urbantwin.lidar.actor_path import ActorPath, PosedActor
from urbantwin.lidar.beams import Beams
from urbantwin.lidar.casting.backend import layers_on
from urbantwin.lidar.compiled.boxes import tight_boxes
from urbantwin.lidar.compiled.pose import poses_at
from urbantwin.lidar.labels import BoxLabel, LabelledFrame
from urbantwin.lidar.labels.borders import Borders
from urbantwin.lidar.labels.frame import Whereabouts
from urbantwin.lidar.labels.truncation import StandingActors
from urbantwin.lidar.layers import Paths, PresentActors
from urbantwin.lidar.mounted import MountedSensor, Rig
from urbantwin.lidar.observer import Observation, Sighting
from urbantwin.lidar.returns import ReturnModel
from urbantwin.lidar.sensor_path import SensorPath
from urbantwin.lidar.shapes import MeshSource, ShapeArrays, ShapeTable
from urbantwin.lidar.static import World
from urbantwin.lidar.static_view import StaticView
from urbantwin.lidar.sweep import Sweep
from urbantwin.lidar.timing import sweeps_of
from urbantwin.taxonomy import ACTOR_SEMANTICS, semantic_id

__all__ = ["Scanner"]

_MOST_TRACKS = 0xFFFF
_Value = TypeVar("_Value", bound=np.generic)


class Scanner:
    """Scans frames. What fixed beams meet in the static world is computed here, once.

    Frames are independent: any of them, in any order, in any process or thread, comes out the
    same.

    Args:
        static: the static world, site frame.
        rig: the sensors.
        seed: of all random numbers.
        meshes: gives the mesh of an asset; ``traffic.assets.asset_mesh`` when not given.
        surface: materials of the ground that are finer than the static world's triangles.
        region: where labels count, site frame; everywhere when not given.
        backend: what casts the rays, see `casting.backend.layers_on`.

    Raises:
        InputError: there is no such backend here.
    """

    def __init__(
        self,
        static: LabelledMesh,
        rig: Rig,
        seed: int,
        *,
        meshes: MeshSource | None = None,
        surface: SurfaceMaterials | None = None,
        region: shapely.Polygon | None = None,
        backend: str = "embree",
    ) -> None:
        if meshes is None:
            from urbantwin.traffic.assets import asset_mesh

            meshes = asset_mesh
        device = layers_on(backend)
        self._shapes = ShapeTable(meshes, device)
        self._rig = rig
        self._seed = seed
        self._borders = Borders(rig.sensors, region)
        self._models = [ReturnModel(one, rig.conditions) for one in rig.sensors]
        self._worlds: list[World | None] = []
        self._views: list[StaticView | None] = []
        shared: World | None = None
        self._beams: list[Beams | None] = []
        for one, model in zip(rig.sensors, self._models, strict=True):
            # A pattern that does not repeat has other beams in every turn.
            beams = Beams.of(one) if one.sensor.pattern is None else None
            self._beams.append(beams)
            path = None if rig.ride is not None else one.path(0, seed)
            if path is None or not path.is_fixed:
                # Near nothing in particular: a vehicle goes about the whole site.
                shared = shared or World(static, np.zeros(3), surface, device)
                self._worlds.append(shared)
                self._views.append(None)
                continue
            world = World(static, one.site_SE3_sensor.translation, surface, device)
            self._worlds.append(None if beams else world)
            self._views.append(self._look(one, beams, model, world, path) if beams else None)

    def scan(self, index: int, actors: Sequence[PosedActor]) -> LabelledFrame:
        """Return the frame of that number.

        Args:
            index: the frame's number, from 0; it selects the random numbers.
            actors: everything that moves, around the frame's time, in any order; also the one that
                carries the rig, which is neither hit nor labelled.

        Raises:
            InputError: a track does not fit the 16 bits that label files have for it, or the
                actor that carries the rig is not there.
        """
        rig = self._rig
        carrier = self._carrier(actors)
        present = sorted(
            (actor for actor in actors if actor.track != rig.carrier), key=lambda one: one.track
        )
        shape = np.array([self._shape(actor) for actor in present], np.int64)
        shapes = self._shapes.arrays if present else _NO_SHAPES
        paths = Paths.of([actor.way for actor in present])
        moving = PresentActors(shapes, shape, paths)
        dataset_SE3_site = rig.dataset_pose(carrier)

        sightings: list[tuple[int, Sighting]] = []
        stands = []
        for number, one in enumerate(rig.sensors):
            path = one.path(index, self._seed, carrier)
            (rotation,), (place,) = path.true_poses(np.zeros(1))
            stands.append(Pose(rotation, place))
            for sweep in sweeps_of(one, index, self._seed):
                view = self._view(number, path, sweep, dataset_SE3_site)
                dead = one.dead(index / rig.rate_hz)
                sighting = Sighting(one, self._models[number], view, sweep, moving, dead)
                sightings.append((number, sighting))

        when_s = _observed([sighting for _, sighting in sightings], paths)
        turned, placed = poses_at(when_s, tuple(paths))
        casters = [self._shapes[number].caster for number in shape.tolist()]
        standing = StandingActors(shapes.low[shape], shapes.high[shape], turned, placed, casters)
        borders = self._borders.of(index / rig.rate_hz, stands, standing)
        turned = dataset_SE3_site.rotation @ turned
        placed = dataset_SE3_site.apply(placed)
        hulls = (shapes.hull, shapes.first_hull[shape], shapes.hull_size[shape])
        boxes = tight_boxes(turned, placed, *hulls)
        seen = [
            (number, sighting.report(boxes, (turned, placed), self._seed))
            for number, sighting in sightings
        ]
        return self._labelled(present, boxes, when_s, borders, dataset_SE3_site, seen)

    def _carrier(self, actors: Sequence[PosedActor]) -> ActorPath | None:
        """Return the path of the actor that carries the rig."""
        if self._rig.ride is None:
            return None
        for actor in actors:
            if actor.track == self._rig.carrier:
                return actor.way
        raise InputError(
            f"the rig rides on track {self._rig.carrier}, which is not in this frame",
            expected="an actor that is there in every recorded frame",
        )

    def _view(
        self, number: int, path: SensorPath, sweep: Sweep, dataset_SE3_site: Pose
    ) -> StaticView:
        """Return the static world as a sensor sees it in a turn: kept where nothing changes."""
        kept = self._views[number]
        if kept is not None:
            return kept
        world = self._worlds[number]
        assert world is not None
        one = self._rig.sensors[number]
        beams = self._beams[number] or Beams.of(one, sweep.turn)
        model = self._models[number]
        return StaticView.of(one, beams, model, world, path, sweep, dataset_SE3_site)

    def _look(
        self,
        one: MountedSensor,
        beams: Beams,
        model: ReturnModel,
        world: World,
        path: SensorPath,
    ) -> StaticView:
        sweep = Sweep.snapshot(one.columns, one.sensor.channels)
        return StaticView.of(one, beams, model, world, path, sweep, self._rig.dataset_SE3_site)

    def _labelled(
        self,
        actors: Sequence[PosedActor],
        boxes: NDArray[np.float64],
        when_s: NDArray[np.float64],
        borders: tuple[NDArray[np.float64], list[Whereabouts | None]],
        dataset_SE3_site: Pose,
        seen: Sequence[tuple[int, Observation]],
    ) -> LabelledFrame:
        """Fuse the sensors' returns and give every point and actor its labels."""
        parts = [one for _, one in seen]
        actor = _joined([one.actor for one in parts], np.int32)
        semantic = _joined([one.semantic for one in parts], np.uint16)
        instance = np.zeros(len(actor), np.uint16)
        hit = np.flatnonzero(actor >= 0)
        classes = [semantic_id(ACTOR_SEMANTICS[one.actor_class]) for one in actors]
        semantic[hit] = np.array(classes, np.uint16)[actor[hit]]
        instance[hit] = np.array([one.track for one in actors], np.uint16)[actor[hit]]
        count = np.bincount(actor[hit], minlength=len(actors))
        alone = np.zeros(len(actors), np.int64)
        for one in parts:
            alone += one.alone
        velocity = np.array([one.velocity for one in actors]).reshape(-1, 3)
        velocity = velocity @ dataset_SE3_site.rotation.T
        points = [one.points for one in parts]
        return LabelledFrame(
            points[0] if len(points) == 1 else np.concatenate([np.zeros((0, 4), "f4"), *points]),
            semantic,
            instance,
            np.repeat(
                np.array([number for number, _ in seen], np.uint8),
                [len(one.actor) for one in parts],
            ),
            _joined([one.ring for one in parts], np.uint16),
            _joined([one.column for one in parts], np.uint16),
            _joined([one.time_s for one in parts], np.float32),
            _joined([one.echo for one in parts], np.uint8),
            tuple(
                BoxLabel(
                    one.track,
                    one.actor_class,
                    boxes[number],
                    int(count[number]),
                    int(alone[number]),
                    velocity[number],
                    float(when_s[number]),
                    float(borders[0][number]),
                    borders[1][number],
                )
                for number, one in enumerate(actors)
            ),
        )

    def _shape(self, actor: PosedActor) -> int:
        if not 0 < actor.track <= _MOST_TRACKS:
            raise InputError(
                f"track {actor.track} does not fit a label", expected=f"1 to {_MOST_TRACKS}"
            )
        return self._shapes.number(actor.asset, actor.phase)


def _observed(sightings: Sequence[Sighting], paths: Paths) -> NDArray[np.float64]:
    """Return when each actor (A,) was seen: the mean over all beams that met it.

    One that none met stands in its box when the first sensor looks towards it.
    """
    count = len(paths.time_s)
    total, beams = np.zeros(count), np.zeros(count)
    for one in sightings:
        beams += one.seen
        total += np.where(one.seen > 0, one.seen_s * one.seen, 0.0)
    unseen = np.flatnonzero(beams == 0)
    when_s = np.divide(total, beams, out=np.zeros(count), where=beams > 0)
    if len(unseen) and sightings:
        _, places = poses_at(np.zeros(count), tuple(paths))
        when_s[unseen] = sightings[0].looks_at_s(places[unseen])
    return when_s


def _joined(parts: Sequence[NDArray[_Value]], kind: type[_Value]) -> NDArray[_Value]:
    """Join the sensors' arrays; one sensor's is taken as it is."""
    return parts[0] if len(parts) == 1 else np.concatenate([np.zeros(0, kind), *parts])


_NO_SHAPES = ShapeArrays(
    np.zeros(0, np.uint64),
    np.zeros(0, np.int64),
    np.zeros((0, 3)),
    np.zeros(0),
    np.zeros(0, np.bool_),
    np.zeros((0, 3)),
    np.zeros((0, 3), np.int32),
    np.zeros(0, np.uint8),
    np.zeros((3, 0)),
    np.zeros(0, np.int64),
    np.zeros(0, np.int64),
    np.zeros((0, 3)),
    np.zeros((0, 3)),
)
