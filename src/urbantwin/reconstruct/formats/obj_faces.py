"""The ``f`` lines of an OBJ: ``1 2 3``, ``1/2 ...``, ``1//3 ...``, ``1/2/3 ...``, ``-3 -2 -1``."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

__all__ = ["face_corners"]

_SPACE, _SLASH, _MINUS, _PLUS, _ZERO, _NINE = (ord(letter) for letter in " /-+09")
#: No model has more vertices than this: a longer number is no number of a vertex.
_MOST = 1 << 40


def face_corners(
    body: NDArray[np.uint8], starts: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Return the numbers that faces are written with.

    Args:
        body: bytes of the lines without their ``f``.
        starts: where each line starts in it.

    Returns:
        vertex (C,) and texture coordinate (C,; 0 for none) of every corner as written, and the
        number of corners of each line.

    Raises:
        ValueError: a corner is not a number; its argument is the index among the lines.
    """
    # A corner takes two bytes at least: a digit and what parts it from the next.
    vertex = np.zeros(len(body) // 2 + 1, np.int64)
    texture = np.zeros(len(vertex), np.int64)
    sizes = np.zeros(len(starts), np.int64)
    ends = np.append(starts[1:], len(body))
    count, wrong = _scan(body, starts, ends, vertex, texture, sizes)
    if wrong >= 0:
        raise ValueError(int(wrong))
    return vertex[:count].copy(), texture[:count].copy(), sizes


@numba.njit(cache=True)
def _scan(body, starts, ends, vertex, texture, sizes):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Fill the numbers; return how many corners there are, and the first wrong line or -1."""
    count = 0
    numbers = np.zeros(3, np.int64)
    for line in range(len(starts)):
        at, end = starts[line], ends[line]
        while True:
            while at < end and body[at] <= _SPACE:
                at += 1
            if at >= end:
                break
            at = _corner(body, at, end, numbers)
            if at < 0:
                return count, line
            vertex[count], texture[count] = numbers[0], numbers[1]
            count += 1
            sizes[line] += 1
    return count, -1


@numba.njit(cache=True)
def _corner(body, at, end, numbers):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Fill the numbers of a corner, 0 for none; return where it ends, -1 where it is none."""
    numbers[:] = 0
    for field in range(3):
        sign = 1
        if at < end and (body[at] == _MINUS or body[at] == _PLUS):
            sign = -1 if body[at] == _MINUS else 1
            at += 1
        first = at
        while at < end and _ZERO <= body[at] <= _NINE and numbers[field] < _MOST:
            numbers[field] = numbers[field] * 10 + (int(body[at]) - _ZERO)
            at += 1
        if at == first and (field == 0 or sign < 0):
            return -1
        numbers[field] *= sign
        if at >= end or body[at] != _SLASH:
            break
        at += 1
    return at if at >= end or body[at] <= _SPACE else -1
