"""Casting on the processor, from compiled code, by Embree or by the built-in tracer."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry.rays import cast_addresses
from urbantwin.lidar.actor_path import Paths
from urbantwin.lidar.casting.tracer import Blocks, Casting, Firing, Layers
from urbantwin.lidar.compiled.cast import cast_blocks
from urbantwin.lidar.shapes import PresentActors, Triangles

__all__ = ["ProcessorTracer", "Targets"]


class Targets(NamedTuple):
    """A actors as compiled code casts at them; all in the actors' frames but the paths.

    Attributes:
        tree: (A,) uint64, address of the tree of each actor's shape; 0 where no ray is cast at it.
        first_face: (A,) int64, where the faces of each begin among the triangles.
        low: (A, 3) float64, lower corners of the bounds.
        high: (A, 3) float64, upper corners.
        triangles: of all shapes.
        paths: how the actors move.
    """

    tree: NDArray[np.uint64]
    first_face: NDArray[np.int64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    triangles: Triangles
    paths: Paths


class ProcessorTracer:
    """Casts on the processor; see `tracer.RayTracer`.

    Args:
        library: ``embree`` or ``bvh``, see `geometry.rays`.
    """

    def __init__(self, library: str) -> None:
        self._library = library

    def layers(
        self, firing: Firing, actors: PresentActors, blocks: Blocks, casting: Casting
    ) -> Layers:
        """Return the layers that blocks of rays meet."""
        shapes, shape = actors.shapes, actors.shape
        trees = [0] * len(shape)
        numbers = shape.tolist()
        for actor in set(blocks.actor.tolist()):  # only shapes that rays are cast at need a tree
            trees[actor] = shapes.scenes[numbers[actor]].tree(self._library)
        targets = Targets(
            np.array(trees, np.uint64),
            shapes.first_face[shape],
            actors.low,
            actors.high,
            shapes.triangles,
            actors.paths,
        )
        address = cast_addresses(self._library)
        room = len(blocks.ray) + len(blocks.ray) // 2 + 1024
        while True:
            layers = Layers.room(room, len(shape))
            used = cast_blocks(address, firing, targets, blocks, casting, layers)
            if used <= room:
                return layers.found(used)
            room = used
