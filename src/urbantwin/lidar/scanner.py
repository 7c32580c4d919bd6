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
    """Merge the returns of all sensors, and label every point and actor.

    Args:
        seen: reports of all turns.
        actors: actors, in the order in which returns number them.
        boxes: (A, 7) boxes of the actors, dataset frame.
        when_s: (A,) times of the boxes, seconds relative to the frame's.
        bordering: truncation and position of the actors.
        dataset_SE3_site: to the frame of the points.
    """
    points = [item.points for item in seen]
    actor = _joined([item.actor for item in seen], np.int32)
    semantic = _joined([item.semantic for item in seen], np.uint16)
    instance = np.zeros(len(actor), np.uint16)
    hit = np.flatnonzero(actor >= 0)
    owner = actor[hit]
    classes = [semantic_id(BOX_SEMANTICS[item.actor_class]) for item in actors]
    semantic[hit] = np.array(classes, np.uint16)[owner]
    tracks = [item.track for item in actors]
    instance[hit] = np.array(tracks, np.uint16)[owner]
    count = np.bincount(owner, minlength=len(actors))
    alone = np.sum([item.alone for item in seen], axis=0, dtype=np.int64).reshape(-1)
    alone = alone if seen else np.zeros(len(actors), np.int64)
    velocity = np.array([item.velocity for item in actors]).reshape(-1, 3)
    velocity = velocity @ dataset_SE3_site.rotation.T
    sensor = np.array([item.sensor for item in seen], np.uint8)
    return LabelledFrame(
        _joined([item.xyzi for item in points], np.float32, (0, 4)),
        semantic,
        instance,
        np.repeat(sensor, [len(item.actor) for item in seen]),
        _joined([item.ring for item in points], np.uint16),
        _joined([item.column for item in points], np.uint16),
        _joined([item.time_s for item in points], np.float32),
        _joined([item.echo for item in seen], np.uint8),
        tuple(
            starmap(
                BoxLabel,
                zip(
                    tracks,
                    [item.actor_class for item in actors],
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
    """Concatenate the arrays of the turns; a single one is returned without a copy."""
    return parts[0] if len(parts) == 1 else np.concatenate([np.zeros(none, kind), *parts])


class Scanner:
    """Scans frames. What fixed beams hit in the static world is computed once.

    Frames are independent: any order, process or thread gives the same result.

    Args:
        static: the static world, site frame.
        rig: the sensors.
        seed: random seed.
        meshes: returns the mesh of an asset; ``traffic.assets.asset_mesh`` if not given.
        surface: materials of the ground at finer resolution than the static world's triangles.
        region: area where labels count, site frame; everywhere if not given.
        backend: ray tracer, see `casting.backend.tracer_on`.
        beside: scanner of another rig in the same world, with the same meshes and backend; both
            share the shapes of actors and the static world of moving sensors.
        standing: static views of the fixed sensors, from the property `standing` of a scanner of
            the same rig in the same world; computed if not given.

    Raises:
        InputError: the backend is not available.
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
        for number, mounted in enumerate(rig.sensors):
            model = ReturnModel(mounted, rig.conditions)
            view = None if standing is None else standing[number]
            if view is not None:
                self._eyes.append(_Eye(number, mounted, model, view, view.beams))
                continue
            # A non-repeating pattern has different beams in every turn.
            beams = Beams.of(mounted) if mounted.sensor.pattern is None else None
            path = None if rig.ride is not None else mounted.path(0, seed)
            if path is None or not path.is_fixed:
                # A vehicle moves over the whole site: no origin is near its sensors.
                self._shared = self._shared or World(static, np.zeros(3), surface, self._tracer)
                self._eyes.append(_Eye(number, mounted, model, self._shared, beams))
                continue
            sees: World | StaticView
            sees = World(static, mounted.site_SE3_sensor.translation, surface, self._tracer)
            if beams is not None:
                sweep = Sweep.snapshot(mounted.columns, mounted.sensor.channels)
                frame = rig.dataset_SE3_site
                sees = StaticView.of(mounted, beams, model, sees, path, sweep, frame)
            self._eyes.append(_Eye(number, mounted, model, sees, beams))

    @property
    def standing(self) -> list[StaticView | None]:
        """Static view of each sensor; ``None`` for a sensor that moves."""
        return [view.sees if isinstance(view.sees, StaticView) else None for view in self._eyes]

    def scan(self, index: int, actors: Sequence[PosedActor]) -> LabelledFrame:
        """Return a frame.

        Args:
            index: number of the frame, from 0; selects the random numbers.
            actors: all actors around the frame's time, in any order, including the carrier of the
                rig, which is neither hit nor labelled.

        Raises:
            InputError: a track id does not fit into the 16 bits of label files, or the carrier is
                absent.
        """
        rig, seed, time_s = self._rig, self._seed, index / self._rig.rate_hz
        carrier = self._carrier(actors)
        others = [actor for actor in actors if actor.track != rig.carrier]
        others = sorted(annotated_actors(rig.boxes, others), key=lambda item: item.track)
        present = self._present(others)
        dataset_SE3_site = rig.dataset_pose(carrier)
        paths = [item.path(index, seed, carrier) for item in rig.sensors]

        # Place the beams of every turn, and cast them at the actors that they can touch; the static
        # hits come with the placement.
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
        # An actor's box is at the mean time of its hits. Echoes become detections, and stray echoes
        # are added.
        when_s = _observed(turns, met, present)
        standing = standing_at(when_s, present, dataset_SE3_site)
        seen = [
            observe(turn, layers, present, standing, seed)
            for turn, layers in zip(turns, met, strict=True)
        ]
        # Label the points, and all actors, also those without points.
        poses = [_pose_of(path) for path in paths]
        bordering = self._borders.of(time_s, poses, StandingActors.at(when_s, present))
        boxes = standing.boxes
        if rig.boxes != "tight":
            sizes = [annotated_size(rig.boxes, item, seed) for item in others]
            boxes = track_boxes(standing, sizes, [item.ahead_m for item in others])
        return labelled(seen, others, boxes, when_s, bordering, dataset_SE3_site)

    def _carrier(self, actors: Sequence[PosedActor]) -> ActorPath | None:
        """Return the path of the carrier."""
        if self._rig.ride is None:
            return None
        for actor in actors:
            if actor.track == self._rig.carrier:
                return actor.way
        raise InputError(
            f"the rig is mounted on track {self._rig.carrier}, which is not in this frame",
            expected="an actor that is there in every recorded frame",
        )

    def _present(self, actors: Sequence[PosedActor]) -> PresentActors:
        """Return actors with their shapes, which are built at first use."""
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
        number: index of the sensor.
        mounted: the sensor.
        model: its return model.
        sees: its view of the static world in every turn; for a moving sensor or pattern the whole
            world, which takes a hundred megabytes.
        beams: beams of every turn; ``None`` if they differ.
        known: cached layers of actors that do not move, for a fixed sensor.
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
        """Yield the turns of a frame, with their beams placed."""
        mounted = self.mounted
        dead = dead_beams(mounted, index / mounted.rate_hz)
        # A copy: numba compiles functions once more for read-only arrays.
        dead = np.zeros(0, np.bool_) if dead is None else dead.flatten()
        for sweep in sweeps_of(mounted, index, seed):
            view = self.sees
            known = self.known if isinstance(view, StaticView) else None
            if isinstance(view, World):
                beams = self.beams or Beams.of(mounted, sweep.turn)
                view = StaticView.of(
                    mounted, beams, self.model, view, path, sweep, dataset_SE3_site
                )
            elif mounted.pose_error is not None:
                begin_s = float(sweep.column_time_s.min())
                view = view.believed_from(path, begin_s, dataset_SE3_site)
            yield Turn(self.number, mounted, self.model, view, sweep, dead, known)


def _observed(
    turns: Sequence[Turn], met: Sequence[Layers], actors: PresentActors
) -> NDArray[np.float64]:
    """Return the mean time (A,) of the beams that hit each actor.

    For an actor without hits, the time at which the first sensor points towards it.
    """
    when_s = seen_at(met, len(actors.shape))
    unseen = np.flatnonzero(np.isnan(when_s))
    when_s[unseen] = 0.0
    if len(unseen) and turns:
        _, places = poses_at(np.zeros(len(when_s)), actors.paths)
        when_s[unseen] = turns[0].looks_at_s(places[unseen])
    return when_s


def _pose_of(path: SensorPath) -> Pose:
    """Return the pose of a sensor at the frame's time."""
    (rotation,), (place,) = path.true_poses(np.zeros(1))
    return Pose(rotation, place)
