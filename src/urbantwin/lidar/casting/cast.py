"""Which beams of a turn are cast at what: at each actor those that can touch it, else all."""

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
    """Cast at every actor the beams that can touch it, each where it is when they fire.

    Args:
        tracer: what casts.
        beams: of the sensor.
        firing: of the turn.
        actors: everything that moves.
        range_max_m: an actor wholly beyond it is left out.
        glass: whether beams pass through panes.
        known: what is known of actors that stand, of a sensor that stands and whose beams are the
            same in every turn.
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
        tracer: what casts.
        beams: of the sensor.
        firing: of the turn, with the sensor's poses in the world's frame.
        world: the static world, its only shape.
        glass: whether beams pass through panes.
        thorough: look at the whole footprint of every beam, and not only where neighbours differ:
            it finds what is thinner than the beams are apart.
    """
    rays, rows, wide, around = beams.neighbours
    blocks = Blocks._make((*(np.array([one], np.int64) for one in (0, rows, wide, 0)), rays))
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
        found = Blocks._make(
            (*(np.empty(most, np.int64) for _ in range(4)), np.empty(rays, np.int32))
        )
        used, written = find_blocks(
            low, high, actors.paths, firing, beams.rings, reach, range_max_m, found
        )
        if used <= most and written <= rays:
            return Blocks._make((*(values[:used] for values in found[:4]), found.ray[:written]))
        most, rays = max(most, used), max(rays, written)
