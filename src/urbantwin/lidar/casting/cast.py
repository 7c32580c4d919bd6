"""Selection of the beams of a turn for ray casting: all, or those that can touch an actor."""

from __future__ import annotations

import numpy as np

from urbantwin.lidar.actor_path import Paths
from urbantwin.lidar.beams import Beams
from urbantwin.lidar.casting.known_layers import KnownLayers
from urbantwin.lidar.casting.tracer import Blocks, Casting, Firing, Layers, RayTracer, Spread
from urbantwin.lidar.compiled.blocks import find_blocks, rays_within
from urbantwin.lidar.shapes import PresentActors, Shapes

__all__ = ["cast_actors", "cast_world"]


def cast_actors(
    tracer: RayTracer,
    beams: Beams,
    firing: Firing,
    actors: PresentActors,
    range_max_m: float,
    *,
    glass: bool,
    known: KnownLayers | None = None,
) -> Layers:
    """Cast the beams that can touch each actor, with the actor's pose at their firing times.

    Args:
        tracer: ray tracer.
        beams: beams of the sensor.
        firing: beams of the turn.
        actors: actors of the frame.
        range_max_m: actors wholly beyond it are left out.
        glass: whether beams pass through panes.
        known: cache of layers of actors that do not move, for a fixed sensor with a repeating
            pattern.
    """
    if not len(actors.shape):
        return Layers.room(0, 0)
    if known is not None:
        return known.layers(
            firing,
            actors,
            lambda some: cast_actors(tracer, beams, firing, some, range_max_m, glass=glass),
        )
    blocks = _blocks(beams, firing, actors, range_max_m)
    spread = Spread.AT_EDGES if len(firing.footprint) > 1 else Spread.NOWHERE
    return tracer.layers(firing, actors, blocks, Casting(glass, int(spread), False))


def cast_world(
    tracer: RayTracer,
    beams: Beams,
    firing: Firing,
    world: Shapes,
    *,
    glass: bool,
    thorough: bool,
) -> Layers:
    """Cast every beam at the static world.

    Args:
        tracer: ray tracer.
        beams: beams of the sensor.
        firing: beams of the turn, with the sensor's poses in the world's frame.
        world: the static world, as a single shape.
        glass: whether beams pass through panes.
        thorough: cast the whole footprint of every beam, not only at edges; finds objects thinner
            than the beam spacing.
    """
    rays, rows, wide, around = beams.neighbours
    blocks = Blocks._make((*(np.array([value], np.int64) for value in (0, rows, wide, 0)), rays))
    spread = Spread.NOWHERE
    if len(firing.footprint) > 1:
        spread = Spread.EVERYWHERE if thorough else Spread.AT_EDGES
    standing = PresentActors(world, np.zeros(1, np.int64), Paths.standing())
    return tracer.layers(firing, standing, blocks, Casting(glass, int(spread), around))


def _blocks(beams: Beams, firing: Firing, actors: PresentActors, range_max_m: float) -> Blocks:
    """Return the blocks of beams that can touch actors."""
    low, high = actors.low, actors.high
    reach = beams.footprint.reach
    if beams.rings is None:
        within: Blocks = rays_within(low, high, actors.paths, firing, reach, range_max_m)
        return within
    most, rays = 2 * len(low), 1 << 16
    while True:
        room = Blocks._make(
            (*(np.empty(most, np.int64) for _ in range(4)), np.empty(rays, np.int32))
        )
        used, written = find_blocks(
            low, high, actors.paths, firing, beams.rings, reach, range_max_m, room
        )
        if used <= most and written <= rays:
            return Blocks._make((*(values[:used] for values in room[:4]), room.ray[:written]))
        most, rays = max(most, used), max(rays, written)
