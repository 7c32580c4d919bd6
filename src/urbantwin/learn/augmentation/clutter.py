"""Augmentation by unlabelled obstacles (bushes, hedges, walls, trunks, bins) with their shadows.

A twin made from a map alone has few objects beside its streets, and a detector trained on such
twins takes bushes for cars. Rays end at an obstacle; they penetrate plants. Frequencies and sizes
of obstacles are estimates.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from urbantwin.learn.compiled.obstacles import met
from urbantwin.learn.frames import RINGS, LevelFrame

__all__ = ["Obstacles", "cluttered", "with_obstacles"]

#: Share of samples with obstacles, and mean of their exponentially distributed number.
_OFTEN, _THINGS = 0.8, 60.0
#: Smallest distance of an obstacle from a sensor and from a labelled box, metres.
_FROM_SENSOR_M, _BESIDE_M = 2.5, 0.05
#: Noise of ranges, metres.
_NOISE_M = 0.02


@dataclass(frozen=True, eq=False)
class Obstacles:
    """Ellipsoids and boxes that obstacles consist of.

    Attributes:
        middle: (K, 3) centres, metres, z above the ground.
        half: (K, 3) half of length, width and height, metres.
        yaw: (K,) radians.
        is_round: (K,) true for ellipsoids.
        depth: (K,) mean penetration depth of rays, metres; 0: solid.
    """

    middle: NDArray[np.float64]
    half: NDArray[np.float64]
    yaw: NDArray[np.float64]
    is_round: NDArray[np.bool_]
    depth: NDArray[np.float64]


def cluttered(
    frame: LevelFrame, window: tuple[float, float, float], draw: np.random.Generator
) -> LevelFrame:
    """Insert random obstacles into most frames.

    Args:
        frame: frame; with several sensors, its points have rings.
        window: x, y and half the edge of the area of obstacles, metres.
        draw: random generator.
    """
    if draw.random() > _OFTEN:
        return frame
    parts: list[_Part] = []
    whose: list[int] = []
    for number in range(int(draw.poisson(draw.exponential(_THINGS)))):
        kind = _KINDS[int(draw.choice(len(_KINDS), p=_SHARES))]
        x, y = np.array(window[:2]) + draw.uniform(-window[2], window[2], 2)
        thing = kind(float(x), float(y), draw.uniform(-np.pi, np.pi), draw)
        parts += thing
        whose += [number] * len(thing)
    table = np.array(parts, np.float64).reshape(-1, 9)
    things = np.array(whose, np.int64)
    table = table[~np.isin(things, things[_taken(frame, table)])]
    if not len(table):
        return frame
    # Contiguous columns: numba compiles a function again for each other layout.
    x, y, z, length, width, height, yaw, is_round, depth = np.ascontiguousarray(table.T)
    stands = Obstacles(
        np.column_stack([x, y, z]),
        np.column_stack([length, width, height]) / 2,
        yaw,
        is_round > 0,
        depth,
    )
    return with_obstacles(frame, stands, draw)


def with_obstacles(frame: LevelFrame, stands: Obstacles, draw: np.random.Generator) -> LevelFrame:
    """Move the points of a frame onto the obstacles that block their rays.

    Args:
        frame: see `cluttered`.
        stands: obstacles.
        draw: random generator for noise and penetration depths.
    """
    whose = np.zeros(len(frame.points), np.int32)
    if len(frame.sensors) > 1:
        whose = frame.ring // RINGS  # -1 where it is unknown
    deep = draw.standard_exponential(len(whose), np.float32)
    brightness = draw.uniform(0.05, 0.6, len(stands.yaw))
    seen_by = np.maximum(whose, 0)
    share, which = met(frame.points, seen_by, frame.sensors, stands.middle, stands.half, stands.yaw,
                       stands.is_round, stands.depth, deep)  # fmt: skip
    moved = (which >= 0) & (whose >= 0)
    points = frame.points.copy()
    start = frame.sensors[seen_by[moved]]
    way = points[moved, :3] - start
    far = np.linalg.norm(way, axis=1, keepdims=True)
    ends = share[moved, None] + draw.normal(0.0, _NOISE_M, far.shape) / far
    points[moved, :3] = (start + way * ends).astype(np.float32)
    if points.shape[1] > 3:
        points[moved, 3] = brightness[which[moved]]
    # Obstacles have no semantic class.
    return replace(frame, points=points, semantic=np.where(moved, 0, frame.semantic))


#: x, y, z of the middle, length, width, height, yaw, whether round, depth.
_Part = tuple[float, float, float, float, float, float, float, float, float]


def _taken(frame: LevelFrame, parts: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which of (K, 9) parts would lie in a labelled box or at a sensor."""
    reach = np.hypot(parts[:, 3], parts[:, 4]) / 2
    boxes = np.hypot(frame.box[:, 3], frame.box[:, 4]) / 2 + _BESIDE_M
    places = np.concatenate([frame.box[:, :2], frame.sensors[:, :2]])
    clear = np.concatenate([boxes, np.full(len(frame.sensors), _FROM_SENSOR_M)])
    apart = np.linalg.norm(parts[:, None, :2] - places, axis=2)
    return np.asarray((apart < reach[:, None] + clear).any(axis=1))


def _bush(x: float, y: float, yaw: float, draw: np.random.Generator) -> Sequence[_Part]:
    """Return a bush: overlapping ellipsoids."""
    parts, size, depth = [], draw.uniform(0.3, 1.6), _let_in(draw)
    for _ in range(int(draw.integers(1, 6))):
        at = draw.normal(0.0, 0.6 * size, 2)
        wide, long = 2 * size * draw.uniform(0.5, 1.0, 2)
        high = draw.uniform(0.7, 2.6)
        parts.append((x + at[0], y + at[1], 0.4 * high, long, wide, 1.2 * high, yaw, 1.0, depth))
    return parts


def _thicket(x: float, y: float, yaw: float, draw: np.random.Generator) -> Sequence[_Part]:
    """Return a garden: separate tufts of leaves, on stems and on the ground."""
    parts, reach = [], draw.uniform(1.0, 4.0)
    for _ in range(int(draw.integers(4, 16))):
        along, across = draw.normal(0.0, (reach, reach / 3))
        at = (x + along * np.cos(yaw) - across * np.sin(yaw),
              y + along * np.sin(yaw) + across * np.cos(yaw))  # fmt: skip
        long, wide, high = draw.uniform(0.3, 1.2, 3)
        parts.append((*at, draw.uniform(0.2, 2.5), long, wide, high, draw.uniform(-np.pi, np.pi),
                      1.0, _let_in(draw)))  # fmt: skip
    return parts


def _row(
    x: float, y: float, yaw: float, draw: np.random.Generator, *, is_plant: bool
) -> Sequence[_Part]:
    """Return a hedge, wall or fence of pieces; some pieces may be missing."""
    high = draw.uniform(0.5, 2.2)
    wide = draw.uniform(0.4, 1.3) if is_plant else draw.uniform(0.1, 0.35)
    depth = _let_in(draw) if is_plant else 0.0
    edge, whole, parts = draw.uniform(0.4, 2.0), draw.uniform(0.5, 1.3), []
    for k in range(int(draw.integers(2, 13))):
        lift = high * (draw.uniform(0.85, 1.15) if is_plant else 1.0)
        at = (x + k * edge * np.cos(yaw), y + k * edge * np.sin(yaw))
        if draw.random() < whole:
            parts.append((*at, lift / 2, edge, wide, lift, yaw, 0.0, depth))
    return parts


def _let_in(draw: np.random.Generator) -> float:
    """Draw the penetration depth of rays into leaves, metres: from dense hedges to few twigs."""
    return float(np.exp(draw.uniform(np.log(0.04), np.log(1.0))))


def _hedge(x: float, y: float, yaw: float, draw: np.random.Generator) -> Sequence[_Part]:
    return _row(x, y, yaw, draw, is_plant=True)


def _wall(x: float, y: float, yaw: float, draw: np.random.Generator) -> Sequence[_Part]:
    return _row(x, y, yaw, draw, is_plant=False)


def _bin(x: float, y: float, yaw: float, draw: np.random.Generator) -> Sequence[_Part]:
    """Return a bin, cabinet, heap or container: a box of 0.3 to 3 m length."""
    length = np.exp(draw.uniform(np.log(0.3), np.log(3.0)))
    width, high = length * draw.uniform(0.4, 1.0), draw.uniform(0.5, 2.0)
    return [(x, y, high / 2, length, width, high, yaw, float(draw.random() < 0.3), 0.0)]


def _posts(x: float, y: float, yaw: float, draw: np.random.Generator) -> Sequence[_Part]:
    """Return a bollard, meter, hydrant or post (some with a plate), or a row of them."""
    thick, high = draw.uniform(0.08, 0.5), draw.uniform(0.7, 2.5)
    apart, wide = draw.uniform(0.5, 2.5), thick * draw.uniform(0.5, 1.0)
    count = 1 if draw.random() < 0.6 else int(draw.integers(2, 9))
    parts: list[_Part] = []
    for k in range(count):
        at = (x + k * apart * np.cos(yaw), y + k * apart * np.sin(yaw))
        parts.append((*at, high / 2, thick, wide, high, yaw, 0.0, 0.0))
    if draw.random() < 0.25:
        long, tall = draw.uniform(0.3, 0.9, 2)
        parts.append((x, y, high - tall / 2, long, 0.06, tall, draw.uniform(-np.pi, np.pi),
                      0.0, 0.0))  # fmt: skip
    return parts


def _tree(x: float, y: float, yaw: float, draw: np.random.Generator) -> Sequence[_Part]:
    """Return a trunk or mast, often with a crown down to head height."""
    thick, high = draw.uniform(0.08, 0.8), draw.uniform(1.5, 5.0)
    parts = [(x, y, high / 2, thick, thick * draw.uniform(0.7, 1.0), high, yaw, 0.0, 0.0)]
    if draw.random() < 0.5:
        wide, below = draw.uniform(1.0, 4.0), draw.uniform(0.8, 3.0)
        parts.append((x, y, below + 1.5, wide, wide, 3.0, yaw, 1.0, draw.uniform(0.3, 1.0)))
    return parts


_KINDS: tuple[Callable[[float, float, float, np.random.Generator], Sequence[_Part]], ...] = (
    _bush,
    _thicket,
    _hedge,
    _wall,
    _bin,
    _posts,
    _tree,
)
_SHARES = (0.18, 0.18, 0.12, 0.08, 0.1, 0.2, 0.14)
