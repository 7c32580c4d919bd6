"""The ``f`` lines of an OBJ: ``1 2 3``, ``1/2 ...``, ``1//3 ...``, ``1/2/3 ...``, ``-3 -2 -1``."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from urbantwin.reconstruct.formats.text_lines import numbers_of

__all__ = ["face_corners"]

_SLASH, _SPACE = ord("/"), ord(" ")


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
        ValueError: a corner is no number; its argument is the index among the lines.
    """
    visible = body > _SPACE
    started = visible.copy()
    started[1:] &= ~visible[:-1]
    sizes = np.add.reduceat(started.astype(np.int64), starts)
    slash = np.cumsum(body == _SLASH)
    first = np.flatnonzero(started)
    token = np.cumsum(started) - 1
    # Slashes before a letter in its own token: 0 vertex, 1 texture, 2 normal.
    field = np.where(visible, slash - slash[first][np.maximum(token, 0)], -1)
    vertex = _integers(np.where(field == 0, body, _SPACE).astype(np.uint8))
    if len(vertex) != len(first):
        raise ValueError(int(np.searchsorted(np.cumsum(sizes), len(vertex), side="right")))
    texture = np.zeros(len(first), np.int64)
    second = (field == 1) & (body != _SLASH)
    if second.any():
        named = token[second]  # rising
        has = named[np.concatenate([[True], named[1:] != named[:-1]])]
        values = _integers(np.where(second, body, _SPACE).astype(np.uint8))
        if len(values) != len(has):
            line = np.searchsorted(np.cumsum(sizes), has[len(values)], side="right")
            raise ValueError(int(line))
        texture[has] = values
    return vertex, texture, sizes


def _integers(body: NDArray[np.uint8]) -> NDArray[np.int64]:
    return numbers_of(body.tobytes(), np.int64).astype(np.int64)
