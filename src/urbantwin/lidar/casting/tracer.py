"""What a ray tracer is given of one turn of a sensor, and what it finds: its interface."""

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
    """``site_SE3_sensor`` when each column fires, or once for a sensor that stands still.

    Attributes:
        rotation: (K, 3, 3) or (1, 3, 3) float64.
        translation: (K, 3) or (1, 3) float64.
    """

    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]


class Firing(NamedTuple):
    """The N = C K beams of a turn: when and from where each fires, and which way it points.

    Attributes:
        column_time_s: (K,) float64, when each column begins, seconds from the frame's time.
        ring_time_s: (C,) float64, when each channel fires within its column.
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
        """Put together the beams of a sensor, their times and its poses."""
        return cls(
            sweep.column_time_s,
            sweep.ring_time_s,
            *poses,
            beams.directions,
            beams.footprint.offset,
        )


class Blocks(NamedTuple):
    """B blocks of rays, each to be cast at its own actor.

    Attributes:
        actor: (B,) int64.
        rows: (B,) int64.
        wide: (B,) int64, rays in a row.
        start: (B,) int64, where the rays of each begin below.
        ray: (R,) int32, beams in rows of neighbours; -1 for none.
    """

    actor: NDArray[np.int64]
    rows: NDArray[np.int64]
    wide: NDArray[np.int64]
    start: NDArray[np.int64]
    ray: NDArray[np.int32]


class Spread(IntEnum):
    """Where beams are cast as the rays of their footprint, and not as their axis alone."""

    NOWHERE = 0
    AT_EDGES = 1
    EVERYWHERE = 2


class Casting(NamedTuple):
    """How rays are cast.

    Attributes:
        glass: whether they pass through panes.
        spread: see `Spread`.
        around: whether the last ray of a row is the neighbour of its first.
    """

    glass: bool
    spread: int
    around: bool


class Layers(NamedTuple):
    """L surfaces that beams meet, wholly or in part.

    Attributes:
        ray: (L,) int32, the beam.
        actor: (L,) int32, whose surface it is; 0 for all of the static world.
        mask: (L,) uint8, which of the beam's rays meet it, a bit for each, with
            `layer_rule.ON_AXIS` where the beam's axis passes through the actor's bounds.
        range_m: (L,) float32.
        cosine: (L,) float32, of the angle between the beam's axis and the surface's normal.
        face: (L,) int32, of the actor's mesh.
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

    @classmethod
    def room(cls, layers: int, actors: int) -> Layers:
        """Return room for so many layers to be written, and actors that no beam met yet."""
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
        """Return the first layers that were written, with the mean of the times added up."""
        mean = self.seen_s / np.where(self.seen > 0, self.seen, np.nan)
        return Layers._make((*(values[:count] for values in self[:6]), mean, self.seen))

    def renumbered(self, actors: NDArray[np.int64], count: int) -> Layers:
        """Return the layers of some of so many actors by the numbers (A,) that these have."""
        seen_s, seen = np.full(count, np.nan), np.zeros(count, np.int64)
        seen_s[actors], seen[actors] = self.seen_s, self.seen
        actor = actors.astype(np.int32).take(self.actor)
        return self._replace(actor=actor, seen_s=seen_s, seen=seen)


class RayTracer(Protocol):
    """Finds what the beams of a turn meet. `layer_rule` says what a layer is."""

    def layers(
        self, firing: Firing, actors: PresentActors, blocks: Blocks, casting: Casting
    ) -> Layers:
        """Return the layers that blocks of rays meet, each of its own actor, in the blocks' order.

        Args:
            firing: the beams of the turn.
            actors: everything that moves, or the static world as the only one.
            blocks: which beams are cast at which actor.
            casting: how.
        """
        ...
