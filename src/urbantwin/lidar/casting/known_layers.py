"""What beams meet of actors that stand before a sensor that stands: found once, and kept."""

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
    """When the beams of a turn fired, and the layers of each actor that stood, by shape and pose.

    Each has its ``seen_s`` and ``seen`` (1,), and no ``actor`` (0,).
    """

    column_time_s: NDArray[np.float64]
    ring_time_s: NDArray[np.float64]
    layers: dict[bytes, Layers]


class KnownLayers:
    """The layers of actors that stood in the last turn of a sensor that stands.

    One that stands where it stood, before beams that fire when they fired, is met alike: whoever
    waits or is parked is cast at only once for as long as it does.
    """

    def __init__(self) -> None:
        nothing = np.zeros(0)
        self._last = _Turn(nothing, nothing, {})

    def layers(
        self, firing: Firing, actors: PresentActors, cast: Callable[[PresentActors], Layers]
    ) -> Layers:
        """Return the layers of actors, and keep those of actors that stand.

        Args:
            firing: the beams of a turn.
            actors: everything that moves.
            cast: returns the layers of some actors, those of an actor next to each other.
        """
        last = self._last  # once: another thread may scan another frame
        before = last.layers
        if not (
            np.array_equal(last.column_time_s, firing.column_time_s)
            and np.array_equal(last.ring_time_s, firing.ring_time_s)
        ):
            before = {}
        keys = _keys(actors, np.flatnonzero(_stands(actors.paths)))
        known = {number: before[key] for number, key in keys.items() if key in before}
        found = cast(actors) if not known else _of_others(actors, known, cast)
        now = {
            key: known[number] if number in known else _of_actor(found, number)
            for number, key in keys.items()
        }
        self._last = _Turn(firing.column_time_s, firing.ring_time_s, now)
        return _together(found, known) if known else found


def _of_others(
    actors: PresentActors, known: dict[int, Layers], cast: Callable[[PresentActors], Layers]
) -> Layers:
    """Return the layers of actors of which nothing is known, by the numbers of all."""
    unknown = np.ones(len(actors.shape), np.bool_)
    unknown[list(known)] = False
    others = np.flatnonzero(unknown)
    return cast(actors.only(others)).renumbered(others, len(unknown))


def _stands(paths: Paths) -> NDArray[np.bool_]:
    """Return which actors (A,) neither move nor turn, to the last digit."""
    still = (paths.translation == paths.translation[:, :1]).all(axis=(1, 2))
    still &= (paths.rotation == paths.rotation[:, :1]).all(axis=(1, 2, 3))
    return np.asarray(still & (paths.turn == 0.0).all(axis=(1, 2)))


def _keys(actors: PresentActors, which: NDArray[np.int64]) -> dict[int, bytes]:
    """Return shape and pose of some actors, to the last digit, by their numbers."""
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


def _together(found: Layers, known: dict[int, Layers]) -> Layers:
    """Return layers with those of other actors among them, by their numbers, in their order."""
    counts = [len(one.ray) for one in known.values()]
    numbers = np.array(list(known), np.int32)
    actor = np.concatenate([found.actor, np.repeat(numbers, counts)])
    order = np.argsort(actor, kind="stable")

    def joined(name: str) -> NDArray[Any]:
        parts = [getattr(one, name) for one in (found, *known.values())]
        return np.asarray(np.concatenate(parts).take(order))

    found.seen_s[numbers] = [one.seen_s[0] for one in known.values()]
    found.seen[numbers] = [one.seen[0] for one in known.values()]
    return Layers(
        joined("ray"),
        actor.take(order),
        joined("mask"),
        joined("range_m"),
        joined("cosine"),
        joined("face"),
        found.seen_s,
        found.seen,
    )
