"""Casting on the processor, by Embree, from compiled code."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry.embree import intersect_address, packet_address
from urbantwin.lidar.actor_path import Paths
from urbantwin.lidar.casting.tracer import Blocks, Casting, Firing, Layers
from urbantwin.lidar.compiled.cast import cast_blocks
from urbantwin.lidar.shapes import PresentActors, Triangles

__all__ = ["EmbreeTracer", "Targets"]


class Targets(NamedTuple):
    """A actors as compiled code casts at them; all in the actors' frames but the paths.

    Attributes:
        scene: (A,) uint64, Embree's scene of each actor's shape; 0 of who is not cast at.
        first_face: (A,) int64, where the faces of each begin among the triangles.
        low: (A, 3) float64, lower corners of the bounds.
        high: (A, 3) float64, upper corners.
        triangles: of all shapes.
        paths: how the actors move.
    """

    scene: NDArray[np.uint64]
    first_face: NDArray[np.int64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    triangles: Triangles
    paths: Paths


class EmbreeTracer:
    """Casts on the processor; see `tracer.RayTracer`."""

    def layers(
        self, firing: Firing, actors: PresentActors, blocks: Blocks, casting: Casting
    ) -> Layers:
        """Return the layers that blocks of rays meet."""
        shapes, shape = actors.shapes, actors.shape
        scenes = [0] * len(shape)
        numbers = shape.tolist()
        for actor in set(blocks.actor.tolist()):  # no tree of who is not cast at
            scenes[actor] = shapes.scenes[numbers[actor]].scene
        targets = Targets(
            np.array(scenes, np.uint64),
            shapes.first_face[shape],
            actors.low,
            actors.high,
            shapes.triangles,
            actors.paths,
        )
        address = (intersect_address(), packet_address())
        room = len(blocks.ray) + len(blocks.ray) // 2 + 1024
        while True:
            layers = Layers.room(room, len(shape))
            used = cast_blocks(address, firing, targets, blocks, casting, layers)
            if used <= room:
                return layers.found(used)
            room = used
