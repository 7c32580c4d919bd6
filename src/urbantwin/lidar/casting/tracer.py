"""Interface of the ray tracers: beams of one turn in, layers out."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from urbantwin.lidar.beams import Beams
from urbantwin.lidar.shapes import PresentActors
from urbantwin.lidar.timing import Sweep

__all__ = ["Blocks", "Casting", "Firing", "Layers", "RayTracer", "SensorPoses", "Spread"]


class SensorPoses(NamedTuple):
    """``site_SE3_sensor`` at the firing of each column, or once for a fixed sensor.

    Attributes:
        rotation: (K, 3, 3) or (1, 3, 3) float64.
        translation: (K, 3) or (1, 3) float64.
    """

    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]


class Firing(NamedTuple):
    """Firing times, origins and directions of the N = C K beams of a turn.

    Attributes:
        column_time_s: (K,) float64, start of each column, seconds relative to the frame's time.
        ring_time_s: (C,) float64, firing time of each channel within its column.
        rotation: (K, 3, 3) or (1, 3, 3) float64 of ``site_SE3_sensor``, see `SensorPoses`.
        translation: (K, 3) or (1, 3) float64.
        directions: (N, 3) float64 unit vectors, sensor frame; beam = channel * K + column.
        footprint: (S, 2) float64, radians across and up from a beam's axis; the first is the axis.
    """

    column_time_s: NDArray[np.float64]
    ring_time_s: NDArray[np.float64]
    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]
    directions: NDArray[np.float64]
    footprint: NDArray[np.float64]

    @classmethod
    def of(cls, beams: Beams, sweep: Sweep, poses: SensorPoses) -> Firing:
        """Combine beams, firing times and poses."""
        return cls(
            sweep.column_time_s,
            sweep.ring_time_s,
            *poses,
            beams.directions,
            beams.footprint.offset,
        )


class Blocks(NamedTuple):
    """B blocks of rays, each for one actor.

    Attributes:
        actor: (B,) int64.
        rows: (B,) int64.
        wide: (B,) int64, rays per row.
        start: (B,) int64, index of each block's first ray.
        ray: (R,) int32, beams in rows of neighbours; -1 for none.
    """

    actor: NDArray[np.int64]
    rows: NDArray[np.int64]
    wide: NDArray[np.int64]
    start: NDArray[np.int64]
    ray: NDArray[np.int32]


class Spread(IntEnum):
    """Where the whole footprint of a beam is cast, and not its axis alone."""

    NOWHERE = 0
    AT_EDGES = 1
    EVERYWHERE = 2


class Casting(NamedTuple):
    """Options of ray casting.

    Attributes:
        glass: whether rays pass through panes.
        spread: see `Spread`.
        around: whether the last ray of a row is a neighbour of its first.
    """

    glass: bool
    spread: int
    around: bool


class Layers(NamedTuple):
    """L surfaces that beams hit with all or some of their rays.

    Attributes:
        ray: (L,) int32, beam.
        actor: (L,) int32, actor; 0 for the static world.
        mask: (L,) uint8, bit mask of the beam's rays that hit it, with `layer_rule.ON_AXIS` if the
            beam's axis passes through the actor's bounds.
        range_m: (L,) float32.
        cosine: (L,) float32, of the angle between the beam's axis and the surface's normal.
        face: (L,) int32, face of the actor's mesh.
        seen_s: (A,) float64, mean hit time of beam axes on each actor; ``nan`` without hits.
        seen: (A,) int64, number of these hits.
    """

    ray: NDArray[np.int32]
    actor: NDArray[np.int32]
    mask: NDArray[np.uint8]
    range_m: NDArray[np.float32]
    cosine: NDArray[np.float32]
    face: NDArray[np.int32]
    seen_s: NDArray[np.float64]
    seen: NDArray[np.int64]

    @classmethod
    def room(cls, layers: int, actors: int) -> Layers:
        """Return uninitialised layers, and zero hits of actors."""
        return cls(
            np.empty(layers, np.int32),
            np.empty(layers, np.int32),
            np.empty(layers, np.uint8),
            np.empty(layers, np.float32),
            np.empty(layers, np.float32),
            np.empty(layers, np.int32),
            np.zeros(actors),
            np.zeros(actors, np.int64),
        )

    def found(self, count: int) -> Layers:
        """Return the first layers, with the mean of the summed hit times."""
        mean = self.seen_s / np.where(self.seen > 0, self.seen, np.nan)
        return Layers._make((*(values[:count] for values in self[:6]), mean, self.seen))

    def renumbered(self, actors: NDArray[np.int64], count: int) -> Layers:
        """Return layers with the indices (A,) of their actors among all."""
        seen_s, seen = np.full(count, np.nan), np.zeros(count, np.int64)
        seen_s[actors], seen[actors] = self.seen_s, self.seen
        actor = actors.astype(np.int32).take(self.actor)
        return self._replace(actor=actor, seen_s=seen_s, seen=seen)


class RayTracer(Protocol):
    """Casts the beams of a turn; `layer_rule` defines layers."""

    def layers(
        self, firing: Firing, actors: PresentActors, blocks: Blocks, casting: Casting
    ) -> Layers:
        """Return the layers of blocks of rays, each with its own actor, in the blocks' order.

        Args:
            firing: beams of the turn.
            actors: actors of the frame, or the static world as the only one.
            blocks: beams to cast at each actor.
            casting: options.
        """
        ...
