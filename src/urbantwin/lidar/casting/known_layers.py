"""Cache of the layers of actors that do not move, for a fixed sensor."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from urbantwin.lidar.actor_path import Paths
from urbantwin.lidar.casting.tracer import Firing, Layers
from urbantwin.lidar.shapes import PresentActors

__all__ = ["KnownLayers"]


class _Turn(NamedTuple):
    """Firing times of a turn, and the layers of each actor that did not move, by shape and pose.

    The layers of an actor have ``seen_s`` and ``seen`` (1,), and no ``actor`` (0,).
    """

    column_time_s: NDArray[np.float64]
    ring_time_s: NDArray[np.float64]
    layers: dict[bytes, Layers]


class KnownLayers:
    """Layers of the actors that did not move in the last turn of a fixed sensor.

    The same pose and the same firing times give the same layers: waiting and parked actors are cast
    once.
    """

    def __init__(self) -> None:
        nothing = np.zeros(0)
        self._last = _Turn(nothing, nothing, {})

    def layers(
        self, firing: Firing, actors: PresentActors, cast: Callable[[PresentActors], Layers]
    ) -> Layers:
        """Return the layers of actors, and cache those of actors that do not move.

        Args:
            firing: beams of a turn.
            actors: actors of the frame.
            cast: returns the layers of some actors, grouped by actor.
        """
        last = self._last  # read once: other threads replace it
        before = last.layers
        if not (
            np.array_equal(last.column_time_s, firing.column_time_s)
            and np.array_equal(last.ring_time_s, firing.ring_time_s)
        ):
            before = {}
        keys = _keys(actors, np.flatnonzero(_stands(actors.paths)))
        cached = {number: before[key] for number, key in keys.items() if key in before}
        cast_layers = cast(actors) if not cached else _of_others(actors, cached, cast)
        now = {
            key: cached[number] if number in cached else _of_actor(cast_layers, number)
            for number, key in keys.items()
        }
        self._last = _Turn(firing.column_time_s, firing.ring_time_s, now)
        return _together(cast_layers, cached) if cached else cast_layers


def _of_others(
    actors: PresentActors, cached: dict[int, Layers], cast: Callable[[PresentActors], Layers]
) -> Layers:
    """Return the layers of the actors that are not cached, by the indices of all."""
    unknown = np.ones(len(actors.shape), np.bool_)
    unknown[list(cached)] = False
    others = np.flatnonzero(unknown)
    return cast(actors.only(others)).renumbered(others, len(unknown))


def _stands(paths: Paths) -> NDArray[np.bool_]:
    """Return which actors (A,) neither move nor turn, exactly."""
    still = (paths.translation == paths.translation[:, :1]).all(axis=(1, 2))
    still &= (paths.rotation == paths.rotation[:, :1]).all(axis=(1, 2, 3))
    return np.asarray(still & (paths.turn == 0.0).all(axis=(1, 2)))


def _keys(actors: PresentActors, which: NDArray[np.int64]) -> dict[int, bytes]:
    """Return shape and pose of some actors as keys, by their indices."""
    rotation, translation = (part[which, 0] for part in actors.paths[1:3])
    rows = np.column_stack([actors.shape[which], rotation.reshape(-1, 9), translation])
    rows = np.ascontiguousarray(rows, np.float64)
    width = rows.shape[1] * rows.itemsize
    return dict(zip(which.tolist(), rows.view(f"V{width}")[:, 0].tolist(), strict=True))


def _of_actor(layers: Layers, number: int) -> Layers:
    own = slice(*np.searchsorted(layers.actor, (number, number + 1)).tolist())
    return Layers(
        layers.ray[own].copy(),
        layers.actor[:0].copy(),
        layers.mask[own].copy(),
        layers.range_m[own].copy(),
        layers.cosine[own].copy(),
        layers.face[own].copy(),
        layers.seen_s[[number]],
        layers.seen[[number]],
    )


def _together(layers: Layers, cached: dict[int, Layers]) -> Layers:
    """Merge cached layers into layers, ordered by actor."""
    counts = [len(part.ray) for part in cached.values()]
    numbers = np.array(list(cached), np.int32)
    actor = np.concatenate([layers.actor, np.repeat(numbers, counts)])
    order = np.argsort(actor, kind="stable")

    def joined(name: str) -> NDArray[Any]:
        parts = [getattr(part, name) for part in (layers, *cached.values())]
        return np.asarray(np.concatenate(parts).take(order))

    layers.seen_s[numbers] = [part.seen_s[0] for part in cached.values()]
    layers.seen[numbers] = [part.seen[0] for part in cached.values()]
    return Layers(
        joined("ray"),
        actor.take(order),
        joined("mask"),
        joined("range_m"),
        joined("cosine"),
        joined("face"),
        layers.seen_s,
        layers.seen,
    )
