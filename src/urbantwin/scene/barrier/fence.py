"""Fences that beams partly penetrate: rails, bars, pales, wires and meshes between posts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from urbantwin.scene.solids import Solid, box, rods, sweep

__all__ = ["bars", "chain", "lattice", "pales", "posts", "rectangle", "strip", "wires"]

#: Depth of posts in the ground, metres.
BURIED_M = 0.3
#: Bars of 20 mm every 130 mm: the gap allowed by codes (a 110 to 120 mm ball must not pass).
BAR_STEP_M, BAR_RADIUS_M = 0.13, 0.012
#: Pales of 80 mm every 160 mm.
PALE_STEP_M, PALE_M = 0.16, 0.08
#: A chain link of 50 mm openings and 3 mm wire hides 1 - (1 - 3/50)^2 = 12 % of the background; it
#: is drawn with fewer and thicker wires that hide the same share.
MESH_STEP_M, MESH_RADIUS_M = 0.36, 0.009
WIRE_RADIUS_M = 0.012


def rectangle(right: float, left: float, low: float, high: float) -> NDArray[np.float64]:
    """Return a rectangular profile of given extents to the right and left, between two heights."""
    return np.array([(left, low), (-right, low), (-right, high), (left, high)])


def strip(
    path: NDArray[np.float64], half: float, low: float, high: float, *, closed: bool
) -> Solid:
    """Return a beam along a path of (N, 3) points of the ground."""
    return sweep(path, rectangle(half, half, low, high), closed=closed)


def posts(path: NDArray[np.float64], height: float, size: float = 0.06) -> Solid:
    """Return a square post at each of (N, 3) points of the ground."""
    centre = path + [0, 0, (height - BURIED_M) / 2]
    return box(centre, np.full((len(path), 3), [size, size, height + BURIED_M]))


def _segments(
    path: NDArray[np.float64], closed: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return starts (M, 3), ends (M, 3) and lengths in plan (M,) of a path's pieces."""
    start = path if closed else path[:-1]
    end = np.roll(path, -1, axis=0) if closed else path[1:]
    return start, end, np.linalg.norm((end - start)[:, :2], axis=1)


def _spaced(
    path: NDArray[np.float64], step: float, closed: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return points (K, 3) every ``step`` along a path, between its corners, and yaws (K,)."""
    start, end, length = _segments(path, closed)
    count = np.maximum(np.round(length / step).astype(int), 1)
    piece = np.repeat(np.arange(len(count)), count)
    number = np.arange(len(piece)) - np.repeat(np.cumsum(count) - count, count)
    share = (number + 0.5) / count[piece]
    way = (end - start)[piece]
    return start[piece] + share[:, None] * way, np.arctan2(way[:, 1], way[:, 0])


def bars(path: NDArray[np.float64], low: float, high: float, *, closed: bool) -> Solid:
    """Return upright round bars between two heights above a path."""
    feet, _ = _spaced(path, BAR_STEP_M, closed)
    up = [0.0, 0.0, 1.0]
    return rods(feet + np.multiply(up, low), feet + np.multiply(up, high), BAR_RADIUS_M,
                BAR_RADIUS_M, 3)  # fmt: skip


def pales(path: NDArray[np.float64], low: float, high: float, *, closed: bool) -> Solid:
    """Return upright boards with gaps between two heights above a path."""
    feet, yaw = _spaced(path, PALE_STEP_M, closed)
    size = np.full((len(feet), 3), [PALE_M, 0.02, high - low])
    return box(feet + [0, 0, (low + high) / 2], size, yaw)


def wires(path: NDArray[np.float64], heights: NDArray[np.float64], *, closed: bool) -> Solid:
    """Return wires at heights (H,) above a path."""
    start, end, _ = _segments(path, closed)
    up = np.zeros((len(heights), 1, 3))
    up[:, 0, 2] = heights
    return rods((start + up).reshape(-1, 3), (end + up).reshape(-1, 3), WIRE_RADIUS_M,
                WIRE_RADIUS_M, 3)  # fmt: skip


def chain(path: NDArray[np.float64], height: float, *, closed: bool) -> Solid:
    """Return a chain between the points of a path, with a sag of a sixth of its height."""
    start, end, _ = _segments(path, closed)
    share = np.linspace(0, 1, 7)[:, None, None]
    points = start + share * (end - start)
    points[..., 2] += height - height / 6 * 4 * (share * (1 - share))[..., 0]
    return rods(points[:-1].reshape(-1, 3), points[1:].reshape(-1, 3), 0.02, 0.02, 3)


def lattice(path: NDArray[np.float64], low: float, high: float, *, closed: bool) -> Solid:
    """Return the wires of a mesh, aslant both ways, between two heights above a path."""
    start, end, length = _segments(path, closed)
    tall = high - low
    count = np.ceil((length + tall) / MESH_STEP_M).astype(int)
    piece = np.repeat(np.arange(len(count)), count)
    number = np.arange(len(piece)) - np.repeat(np.cumsum(count) - count, count)
    offset = -tall + (number + 0.5) * (length + tall)[piece] / count[piece]
    first = np.maximum(0.0, -offset)
    last = np.minimum(tall, length[piece] - offset)
    keep = last - first > 0.03
    piece, offset, first, last = piece[keep], offset[keep], first[keep], last[keep]
    ends = []
    for way in (1, -1):
        for up in (first, last):
            along = (offset + up) / length[piece]
            along = along if way == 1 else 1 - along
            point = start[piece] + along[:, None] * (end - start)[piece]
            ends.append(point + np.column_stack([np.zeros((len(up), 2)), low + up]))
    return rods(
        np.concatenate([ends[0], ends[2]]), np.concatenate([ends[1], ends[3]]),
        MESH_RADIUS_M, MESH_RADIUS_M, 3,
    )  # fmt: skip
