"""Hedges and bushes: low vegetation as uneven closed bodies."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.random import Generator, Philox
from numpy.typing import NDArray

from urbantwin.scene.solids import Solid, sweep
from urbantwin.scene.tree.crown import crown_clumps, rounded

__all__ = ["bushes", "hedge", "leafy_bush", "leafy_hedge", "loose"]

BURIED_M = 0.2
#: Leaves around a hedge's closed body: number per metre, size, and distance from the body, metres.
LEAVES_PER_M, LEAF_M, OUT_M = 6, 0.18, 0.13


def hedge(
    path: NDArray[np.float64], height: float, thickness: float, seed: int, *, closed: bool = False
) -> Solid:
    """Return a hedge along (N, 3) points on the ground: a box with an uneven surface."""
    rng = Generator(Philox(key=abs(seed)))
    half = thickness / 2
    profile = np.array(
        [
            (half, -BURIED_M),
            (-half, -BURIED_M),
            (-half, 0.5 * height),
            (-0.85 * half, height),
            (0.85 * half, height),
            (half, 0.5 * height),
        ]
    )
    outline = np.broadcast_to(profile, (len(path), 6, 2)).copy()
    rough = min(0.08, 0.15 * thickness)
    outline[:, :, 0] += rng.uniform(-rough, rough, outline.shape[:2])
    outline[:, 3:5, 1] -= rng.uniform(0, 2 * rough, (len(path), 2))
    return sweep(path, outline, closed=closed)


def leafy_hedge(
    path: NDArray[np.float64], height: float, thickness: float, seed: int
) -> list[Solid]:
    """Return a hedge along (N, 3) points: a closed body with leaves around it."""
    body = hedge(path, height - OUT_M / 2, thickness - OUT_M, seed)
    step = np.diff(path, axis=0)
    length = np.hypot(step[:, 0], step[:, 1])
    rng = Generator(Philox(key=[abs(seed), 1]))
    count = int(LEAVES_PER_M * length.sum())
    if not count:
        return [body]
    at = rng.random(count) * length.sum()
    ends = np.concatenate([[0.0], np.cumsum(length)])
    foot = np.column_stack([np.interp(at, ends, path[:, k]) for k in range(3)])
    own = np.clip(np.searchsorted(ends, at, side="right") - 1, 0, len(length) - 1)
    across = np.column_stack([-step[own, 1], step[own, 0]]) / np.maximum(length[own], 1e-9)[:, None]
    # Along a hedge's two sides and its top, in proportion to their lengths.
    around = rng.uniform(-1, 1, count) * (height + thickness / 2)
    up = np.minimum(np.abs(around), height)
    half = thickness / 2 - OUT_M / 2
    aside = np.sign(around) * np.where(
        np.abs(around) < height, half, half - (np.abs(around) - height)
    )
    middle = foot + np.column_stack([across * aside[:, None], up])
    corners = middle[:, None] + rng.uniform(-1, 1, (count, 3, 3)) * (LEAF_M, LEAF_M, LEAF_M)
    return [body, loose(rounded(corners))]


def leafy_bush(
    foot: NDArray[np.float64], across: float, height: float, seed: int, count: int
) -> Solid:
    """Return a bush of separate leaves in several lobes, down to the ground, at a point (3,).

    Beams can enter it, and some pass, as in crowns of trees.
    """
    rng = Generator(Philox(key=abs(seed)))
    leaves = crown_clumps("round", across, -0.25 * height, height, rng, count) + foot
    return loose(rounded(leaves))


def loose(leaves: NDArray[np.float64]) -> Solid:
    """Return triangles (N, 3, 3) that share no corners."""
    vertices = leaves.reshape(-1, 3)
    return Solid(vertices, np.arange(len(vertices), dtype=np.int32).reshape(-1, 3))


def bushes(
    feet: NDArray[np.float64], radii: NDArray[np.float64], heights: NDArray[np.float64], seed: int
) -> tuple[Solid, int]:
    """Return bushes: uneven domes on (N, 3) points on the ground; and the faces of each."""
    rng = Generator(Philox(key=abs(seed)))
    ball, faces = _ball()
    count = len(feet)
    swell = rng.uniform(0.75, 1.1, (count, len(ball), 1))
    shape = ball[None] * swell
    shape[..., :2] *= radii[:, None, None]
    # The lower end of the dome is below the ground: its middle is at 40 % of its height.
    shape[..., 2] *= (0.6 * heights)[:, None]
    shape[..., 2] += (0.4 * heights)[:, None]
    vertices = shape + feet[:, None]
    shift = np.arange(count)[:, None, None] * len(ball)
    return Solid(vertices.reshape(-1, 3), (faces[None] + shift).reshape(-1, 3)), len(faces)


@cache
def _ball() -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return a unit sphere of 80 triangles: an icosahedron, each face divided into four."""
    g = (1 + 5**0.5) / 2
    corners: list[tuple[float, float, float]] = [(-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0)]
    corners += [(0, -1, g), (0, 1, g), (0, -1, -g), (0, 1, -g)]
    corners += [(g, 0, -1), (g, 0, 1), (-g, 0, -1), (-g, 0, 1)]
    faces = [(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4)]
    faces += [(11, 10, 2), (10, 7, 6), (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8)]
    faces += [(3, 8, 9), (4, 9, 5), (2, 4, 11), (6, 2, 10), (8, 6, 7), (9, 8, 1)]
    points = [np.array(c, np.float64) for c in corners]
    middle: dict[tuple[int, int], int] = {}

    def between(a: int, b: int) -> int:
        key = (min(a, b), max(a, b))
        if key not in middle:
            middle[key] = len(points)
            points.append((points[a] + points[b]) / 2)
        return middle[key]

    fine = []
    for a, b, c in faces:
        ab, bc, ca = between(a, b), between(b, c), between(c, a)
        fine += [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
    ball = np.array(points)
    return ball / np.linalg.norm(ball, axis=1, keepdims=True), np.array(fine, np.int32)
