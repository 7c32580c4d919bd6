"""One labelled frame of a rig: a pure function of the world, the seed and the frame's number."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import starmap
from typing import TypeVar

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.geometry import LabelledMesh, Pose, SurfaceMaterials
from urbantwin.geometry.rays import LIBRARIES
from urbantwin.lidar.actor_path import ActorPath, Paths, PosedActor
from urbantwin.lidar.annotated import LAST_TRACK, annotated_actors, annotated_size
from urbantwin.lidar.beams import Beams, dead_beams
from urbantwin.lidar.borders import Bordering, Borders, StandingActors
from urbantwin.lidar.casting.backend import tracer_on
from urbantwin.lidar.casting.cast import cast_actors
from urbantwin.lidar.casting.known_layers import KnownLayers
from urbantwin.lidar.casting.tracer import Layers
from urbantwin.lidar.compiled.pose import poses_at
from urbantwin.lidar.labels import BoxLabel, LabelledFrame
from urbantwin.lidar.returns import ReturnModel
from urbantwin.lidar.rig import MountedSensor, Rig
from urbantwin.lidar.sensor_path import SensorPath
from urbantwin.lidar.shapes import MeshSource, PresentActors, ShapeTable
from urbantwin.lidar.standing import seen_at, standing_at, track_boxes
from urbantwin.lidar.static_view import StaticView
from urbantwin.lidar.static_world import World
from urbantwin.lidar.timing import Sweep, sweeps_of
from urbantwin.lidar.turn import Observation, Turn, observe
from urbantwin.taxonomy import BOX_SEMANTICS, semantic_id

__all__ = ["Scanner", "labelled"]

_Value = TypeVar("_Value", bound=np.generic)


def labelled(
    seen: Sequence[Observation],
    actors: Sequence[PosedActor],
    boxes: NDArray[np.float64],
    when_s: NDArray[np.float64],
    bordering: Bordering,
    dataset_SE3_site: Pose,
) -> LabelledFrame:
    """Fuse the sensors' returns and give every point and actor its labels.

    Args:
        seen: what was reported of each turn.
        actors: in the order in which returns number them.
        boxes: (A, 7) of the actors, dataset frame.
        when_s: (A,) when they stood there, seconds from the frame's time.
        bordering: how they lie to the borders of what the rig sees.
        dataset_SE3_site: to the frame of the points.
    """
    points = [one.points for one in seen]
    actor = _joined([one.actor for one in seen], np.int32)
    semantic = _joined([one.semantic for one in seen], np.uint16)
    instance = np.zeros(len(actor), np.uint16)
    hit = np.flatnonzero(actor >= 0)
    owner = actor[hit]
    classes = [semantic_id(BOX_SEMANTICS[one.actor_class]) for one in actors]
    semantic[hit] = np.array(classes, np.uint16)[owner]
    tracks = [one.track for one in actors]
    instance[hit] = np.array(tracks, np.uint16)[owner]
    count = np.bincount(owner, minlength=len(actors))
    alone = np.sum([one.alone for one in seen], axis=0, dtype=np.int64).reshape(-1)
    alone = alone if seen else np.zeros(len(actors), np.int64)
    velocity = np.array([one.velocity for one in actors]).reshape(-1, 3)
    velocity = velocity @ dataset_SE3_site.rotation.T
    sensor = np.array([one.sensor for one in seen], np.uint8)
    return LabelledFrame(
        _joined([one.xyzi for one in points], np.float32, (0, 4)),
        semantic,
        instance,
        np.repeat(sensor, [len(one.actor) for one in seen]),
        _joined([one.ring for one in points], np.uint16),
        _joined([one.column for one in points], np.uint16),
        _joined([one.time_s for one in points], np.float32),
        _joined([one.echo for one in seen], np.uint8),
        tuple(
            starmap(
                BoxLabel,
                zip(
                    tracks,
                    [one.actor_class for one in actors],
                    boxes,
                    count.tolist(),
                    alone.tolist(),
                    velocity,
                    when_s.tolist(),
                    bordering.truncation.tolist(),
                    bordering.whereabouts,
                    strict=True,
                ),
            )
        ),
    )


def _joined(
    parts: Sequence[NDArray[_Value]], kind: type[_Value], none: tuple[int, ...] = (0,)
) -> NDArray[_Value]:
    """Join the turns' arrays; that of one turn is taken as it is."""
    return parts[0] if len(parts) == 1 else np.concatenate([np.zeros(none, kind), *parts])


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
        backend: what casts the rays, see `casting.backend.tracer_on`.
        beside: a scanner of another rig in the same world, with the same meshes and backend: what
            it has of actors, and of the static world for sensors that move, serves both.
        standing: what sensors that stand still see, of a scanner of the same rig in the same world:
            its `standing`; they look for themselves when not given.

    Raises:
        InputError: there is no such backend here.
    """

    def __init__(  # noqa: PLR0913 - most are what scanners share
        self,
        static: LabelledMesh,
        rig: Rig,
        seed: int,
        *,
        meshes: MeshSource | None = None,
        surface: SurfaceMaterials | None = None,
        region: shapely.Polygon | None = None,
        backend: str | None = None,
        beside: Scanner | None = None,
        standing: Sequence[StaticView | None] | None = None,
    ) -> None:
        from urbantwin.traffic.assets import asset_mesh
        from urbantwin.traffic.assets.truck_parts import mesh_of_part

        meshes = asset_mesh if meshes is None else meshes
        self._tracer = tracer_on(backend)
        self._shapes: ShapeTable
        self._shared: World | None = None
        if beside is None:
            library = backend if backend in LIBRARIES else None
            self._shapes = ShapeTable(partial(mesh_of_part, meshes), library)
        else:
            self._shapes, self._shared = beside._shapes, beside._shared
        self._rig = rig
        self._seed = seed
        self._borders = Borders(rig.sensors, region, rig.label_range_m)
        self._eyes: list[_Eye] = []
        for number, one in enumerate(rig.sensors):
            model = ReturnModel(one, rig.conditions)
            known = None if standing is None else standing[number]
            if known is not None:
                self._eyes.append(_Eye(number, one, model, known, known.beams))
                continue
            # A pattern that does not repeat has other beams in every turn.
            beams = Beams.of(one) if one.sensor.pattern is None else None
            path = None if rig.ride is not None else one.path(0, seed)
            if path is None or not path.is_fixed:
                # A vehicle drives all over the site: its sensors are near no place in particular.
                self._shared = self._shared or World(static, np.zeros(3), surface, self._tracer)
                self._eyes.append(_Eye(number, one, model, self._shared, beams))
                continue
            sees: World | StaticView
            sees = World(static, one.site_SE3_sensor.translation, surface, self._tracer)
            if beams is not None:
                sweep = Sweep.snapshot(one.columns, one.sensor.channels)
                frame = rig.dataset_SE3_site
                sees = StaticView.of(one, beams, model, sees, path, sweep, frame)
            self._eyes.append(_Eye(number, one, model, sees, beams))

    @property
    def standing(self) -> list[StaticView | None]:
        """What each sensor sees of the static world; ``None`` where it does not stand still."""
        return [one.sees if isinstance(one.sees, StaticView) else None for one in self._eyes]

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
        rig, seed, time_s = self._rig, self._seed, index / self._rig.rate_hz
        carrier = self._carrier(actors)
        others = [actor for actor in actors if actor.track != rig.carrier]
        others = sorted(annotated_actors(rig.boxes, others), key=lambda one: one.track)
        present = self._present(others)
        dataset_SE3_site = rig.dataset_pose(carrier)
        paths = [one.path(index, seed, carrier) for one in rig.sensors]

        # Place the beams of every turn of every sensor, and cast at each actor those that can
        # touch it; what they meet of the static world comes with their place.
        turns = [
            turn
            for eye, path in zip(self._eyes, paths, strict=True)
            for turn in eye.turns(index, seed, path, dataset_SE3_site)
        ]
        met = [
            cast_actors(
                self._tracer,
                turn.view.beams,
                turn.firing,
                present,
                turn.mounted.sensor.assumed_range_max_m,
                glass=turn.mounted.effects.glass,
                known=turn.known,
            )
            for turn in turns
        ]
        # Actors stand in their boxes where beams met them: of what each turn's beams meet, some
        # is detected, and strays come in between.
        when_s = _observed(turns, met, present)
        standing = standing_at(when_s, present, dataset_SE3_site)
        seen = [
            observe(turn, layers, present, standing, seed)
            for turn, layers in zip(turns, met, strict=True)
        ]
        # Label what was seen, and what was not.
        poses = [_pose_of(path) for path in paths]
        bordering = self._borders.of(time_s, poses, StandingActors.at(when_s, present))
        boxes = standing.boxes
        if rig.boxes != "tight":
            sizes = [annotated_size(rig.boxes, one, seed) for one in others]
            boxes = track_boxes(standing, sizes, [one.ahead_m for one in others])
        return labelled(seen, others, boxes, when_s, bordering, dataset_SE3_site)

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

    def _present(self, actors: Sequence[PosedActor]) -> PresentActors:
        """Return actors with their shapes, which are made when they are first met."""
        for actor in actors:
            if not 0 < actor.track <= LAST_TRACK:
                raise InputError(
                    f"track {actor.track} does not fit a label", expected=f"1 to {LAST_TRACK}"
                )
        shape = [self._shapes.number(actor.asset, actor.phase) for actor in actors]
        paths = Paths.of([actor.way for actor in actors])
        return PresentActors(self._shapes.arrays, np.array(shape, np.int64), paths)


@dataclass(frozen=True, eq=False)
class _Eye:
    """One sensor in the world.

    Attributes:
        number: of the sensor.
        mounted: the sensor.
        model: what it makes of echoes.
        sees: what it sees of the static world in every turn; where it moves, or its beams do, all
            of that world: a hundred megabytes, of which one that stands still needs no more.
        beams: of every turn; ``None``: they are others in each.
        known: what it meets of actors that stand, where it stands.
    """

    number: int
    mounted: MountedSensor
    model: ReturnModel
    sees: World | StaticView
    beams: Beams | None
    known: KnownLayers = field(default_factory=KnownLayers)

    def turns(
        self, index: int, seed: int, path: SensorPath, dataset_SE3_site: Pose
    ) -> Iterator[Turn]:
        """Yield the turns that a frame holds, with their beams placed."""
        one = self.mounted
        dead = dead_beams(one, index / one.rate_hz)
        # A copy: numba compiles functions again for arrays that are read-only.
        dead = np.zeros(0, np.bool_) if dead is None else dead.flatten()
        for sweep in sweeps_of(one, index, seed):
            view = self.sees
            known = self.known if isinstance(view, StaticView) else None
            if isinstance(view, World):
                beams = self.beams or Beams.of(one, sweep.turn)
                view = StaticView.of(one, beams, self.model, view, path, sweep, dataset_SE3_site)
            elif one.pose_error is not None:
                begin_s = float(sweep.column_time_s.min())
                view = view.believed_from(path, begin_s, dataset_SE3_site)
            yield Turn(self.number, one, self.model, view, sweep, dead, known)


def _observed(
    turns: Sequence[Turn], met: Sequence[Layers], actors: PresentActors
) -> NDArray[np.float64]:
    """Return when each actor (A,) was seen: the mean over all beams that met it.

    One that none met stands in its box when the first sensor looks towards it.
    """
    when_s = seen_at(met, len(actors.shape))
    unseen = np.flatnonzero(np.isnan(when_s))
    when_s[unseen] = 0.0
    if len(unseen) and turns:
        _, places = poses_at(np.zeros(len(when_s)), actors.paths)
        when_s[unseen] = turns[0].looks_at_s(places[unseen])
    return when_s


def _pose_of(path: SensorPath) -> Pose:
    """Return where a sensor is at the frame's time."""
    (rotation,), (place,) = path.true_poses(np.zeros(1))
    return Pose(rotation, place)
