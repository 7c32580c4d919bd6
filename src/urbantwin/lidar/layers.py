"""Layers: the surfaces that the beams of a turn meet, wholly or in part."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from urbantwin.lidar.actor_path import ActorPath
from urbantwin.lidar.beams import Beams
from urbantwin.lidar.casting.embree import intersect_address
from urbantwin.lidar.compiled.blocks import find_blocks
from urbantwin.lidar.compiled.bounds import rays_within
from urbantwin.lidar.compiled.layers import cast_blocks
from urbantwin.lidar.shapes import ShapeArrays
from urbantwin.lidar.sweep import Sweep

__all__ = ["Layers", "Paths", "PresentActors", "SensorPoses", "cast_actors", "cast_world"]


class Paths(NamedTuple):
    """The ways of A actors in one frame, padded to the same number T of knots.

    Attributes:
        time_s: (A, T) float64, seconds from the frame's time.
        rotation: (A, T, 3, 3) float64, ``site_SE3_asset``.
        translation: (A, T, 3) float64.
        turn: (A, T - 1, 3) float64, rotation vector from each knot to the next, asset's frame.
    """

    time_s: NDArray[np.float64]
    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]
    turn: NDArray[np.float64]

    @classmethod
    def of(cls, ways: list[ActorPath]) -> Paths:
        """Put paths together; shorter ones go straight on."""
        longest = max((len(way.time_s) for way in ways), default=2)
        count = len(ways)
        if ways and all(len(way.time_s) == longest for way in ways):
            rotation = np.array([way.rotation for way in ways])
            place = np.array([way.translation for way in ways])
            return cls(np.array([way.time_s for way in ways]), rotation, place, _turns(rotation))
        time_s = np.empty((count, longest))
        rotation, place = np.empty((count, longest, 3, 3)), np.empty((count, longest, 3))
        for n, way in enumerate(ways):
            known = len(way.time_s)
            time_s[n, :known] = way.time_s
            rotation[n, :known], place[n, :known] = way.rotation, way.translation
            for k in range(known, longest):
                later = float(way.time_s[-1]) + (k - known + 1)
                pose = way.at(later)
                time_s[n, k], rotation[n, k], place[n, k] = later, pose.rotation, pose.translation
        return cls(time_s, rotation, place, _turns(rotation))

    @classmethod
    def standing(cls) -> Paths:
        """Return the path of the static world: it stands in the site frame."""
        rotation = np.broadcast_to(np.eye(3), (1, 2, 3, 3)).copy()
        return cls(np.array([[0.0, 1.0]]), rotation, np.zeros((1, 2, 3)), np.zeros((1, 1, 3)))


@dataclass(frozen=True, eq=False)
class PresentActors:
    """The actors of a frame.

    Attributes:
        shapes: every shape.
        shape: (A,) int64, the shape of each actor.
        paths: how they move.
    """

    shapes: ShapeArrays
    shape: NDArray[np.int64]
    paths: Paths

    @property
    def first_face(self) -> NDArray[np.int64]:
        """Where the faces (A,) of each actor's shape begin."""
        return np.asarray(self.shapes.first_face[self.shape])


class SensorPoses(NamedTuple):
    """``site_SE3_sensor`` when each column fires, or once for a sensor that stands still.

    Attributes:
        rotation: (K, 3, 3) or (1, 3, 3) float64.
        translation: (K, 3) or (1, 3) float64.
    """

    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Layers:
    """L surfaces that beams meet.

    Attributes:
        ray: (L,) int32, the beam.
        actor: (L,) int32, whose surface it is; 0 for all of the static world.
        mask: (L,) uint8, which of the beam's rays meet it, a bit for each.
        range_m: (L,) float32.
        cosine: (L,) float32, of the angle between the beam's axis and the surface's normal.
        face: (L,) int32, of the mesh.
        seen_s: (A,) float64, mean time at which the axes of beams met each actor; ``nan`` where
            none did.
        seen: (A,) int64, how many did.
    """

    ray: NDArray[np.int32]
    actor: NDArray[np.int32]
    mask: NDArray[np.uint8]
    range_m: NDArray[np.float32]
    cosine: NDArray[np.float32]
    face: NDArray[np.int32]
    seen_s: NDArray[np.float64]
    seen: NDArray[np.int64]


def cast_actors(
    beams: Beams,
    sweep: Sweep,
    poses: SensorPoses,
    actors: PresentActors,
    range_max_m: float,
    *,
    glass: bool,
) -> Layers:
    """Cast at every actor the beams that can touch it, each where it is when they fire.

    Args:
        beams: of the sensor.
        sweep: when they fire.
        poses: where the sensor is.
        actors: everything that moves.
        range_max_m: an actor wholly beyond it is left out.
        glass: whether beams pass through panes.
    """
    if not len(actors.shape):
        return _none(0)
    arrays, paths = actors.shapes, actors.paths
    low, high = arrays.low[actors.shape], arrays.high[actors.shape]
    blocks, rays = _blocks(beams, sweep, poses, low, high, paths, range_max_m)
    spread = 1 if len(beams.footprint.share) > 1 else 0
    return _cast(beams, sweep, poses, actors, blocks, rays, (glass, spread, False))


def cast_world(
    beams: Beams,
    sweep: Sweep,
    poses: SensorPoses,
    world: ShapeArrays,
    *,
    glass: bool,
    thorough: bool,
) -> Layers:
    """Cast every beam at the static world.

    Args:
        beams: of the sensor.
        sweep: when they fire.
        poses: where the sensor is, in the world's frame.
        world: the static world, its only shape.
        glass: whether beams pass through panes.
        thorough: look at the whole footprint of every beam, and not only where neighbours differ:
            it finds what is thinner than the beams are apart.
    """
    rays, rows, wide, around = beams.neighbours()
    blocks = np.array([[0, rows, wide, 0]], np.int64)
    spread = 0
    if len(beams.footprint.share) > 1:
        spread = 2 if thorough else 1
    options = (glass, spread, around)
    standing = PresentActors(world, np.zeros(1, np.int64), Paths.standing())
    return _cast(beams, sweep, poses, standing, blocks, rays, options)


def _turns(rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return rotation vectors (A, T - 1, 3) from each knot's rotation to the next's."""
    count, knots = rotation.shape[:2]
    step = np.swapaxes(rotation[:, :-1], 2, 3) @ rotation[:, 1:]
    still = (np.abs(step - np.eye(3)) < 1e-15).all(axis=(2, 3))
    turn = np.zeros((count, knots - 1, 3))
    if not still.all():
        turn[~still] = Rotation.from_matrix(step[~still]).as_rotvec()
    return turn


def _blocks(
    beams: Beams,
    sweep: Sweep,
    poses: SensorPoses,
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    paths: Paths,
    range_max_m: float,
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Return the blocks of beams that can touch actors, and their beams."""
    room = (np.empty((3, 3)), np.empty(3), np.empty((3, 3)), np.empty(3))
    rings = beams.rings
    reach = beams.footprint.reach
    timing = (sweep.column_time_s, float(sweep.ring_time_s.max()), sweep.first_column)
    if rings is None:
        blocks, rays = rays_within(
            low, high, tuple(paths), *poses, timing, beams.directions, range_max_m, reach, room
        )
        return blocks, rays
    lie = (rings.order, rings.elevation, rings.azimuth, rings.step, rings.turn, reach)
    size = (2 * len(low), 1 << 16)
    while True:
        found = (np.empty((size[0], 4), np.int64), np.empty(size[1], np.int32))
        used, written = find_blocks(
            low, high, tuple(paths), *poses, timing, lie, range_max_m, room, found
        )
        if used <= size[0] and written <= size[1]:
            return found[0][:used], found[1][:written]
        size = (max(size[0], used), max(size[1], written))


def _cast(
    beams: Beams,
    sweep: Sweep,
    poses: SensorPoses,
    actors: PresentActors,
    blocks: NDArray[np.int64],
    rays: NDArray[np.int32],
    options: tuple[bool, int, bool],
) -> Layers:
    arrays, shape, paths = actors.shapes, actors.shape, actors.paths
    if arrays.device is not None:
        when = (sweep.column_time_s, sweep.ring_time_s, *poses)
        spread = (beams.directions, beams.footprint.offset)
        met = arrays.device.cast(arrays, shape, tuple(paths), blocks, rays, when, spread, options)
        return Layers(*met[:6], _mean(met.seen_s, met.seen), met.seen)
    scenes = arrays.scenes[shape]
    shapes = (scenes, actors.first_face, *arrays[2:7], arrays.low[shape], arrays.high[shape])
    columns = beams.columns
    clock = np.zeros(1, np.int64)
    scratch = (np.empty((columns, 15)), np.zeros(columns, np.int64))
    hits = (np.empty(len(rays), np.float32), np.empty(len(rays), np.int32))
    room = len(rays) + len(rays) // 2 + 1024
    while True:
        layers: tuple[NDArray[Any], ...] = (
            np.empty(room, np.int32),
            np.empty(room, np.int32),
            np.empty(room, np.uint8),
            np.empty(room, np.float32),
            np.empty(room, np.float32),
            np.empty(room, np.int32),
        )
        used, total_s, seen = cast_blocks(
            intersect_address(),
            blocks,
            rays,
            shapes,
            tuple(paths),
            *poses,
            (sweep.column_time_s, sweep.ring_time_s),
            beams.directions,
            beams.footprint.offset,
            options,
            (*scratch, *hits, clock),
            layers,
        )
        if used <= room:
            break
        room = used
    ray, actor, mask, range_m, cosine, face = (values[:used] for values in layers)
    return Layers(ray, actor, mask, range_m, cosine, face, _mean(total_s, seen), seen)


def _mean(total: NDArray[np.float64], count: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return means (A,); ``nan`` of nothing."""
    return np.asarray(np.divide(total, count, out=np.full(len(count), np.nan), where=count > 0))


def _none(actors: int) -> Layers:
    whole, real = np.zeros(0, np.int32), np.zeros(0, np.float32)
    return Layers(
        whole,
        whole,
        np.zeros(0, np.uint8),
        real,
        real,
        whole,
        np.full(actors, np.nan),
        np.zeros(actors, np.int64),
    )
