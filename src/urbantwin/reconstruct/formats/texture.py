"""Colours of triangles from the pictures that are laid over them."""

from __future__ import annotations

import io
from pathlib import Path, PureWindowsPath

import numpy as np
from numpy.typing import NDArray
from PIL import Image

__all__ = ["beside", "picture_of", "texture_colours"]

#: Pictures are looked at no finer than this, pixels.
FINEST = 2048
#: A picture with more pixels is refused: nobody lays that over a model.
MOST_PIXELS = 20_000 * 20_000
#: No format packs more pixels into a byte: a file that is too small for what it claims is refused.
_DENSEST = 1100
#: Places in a triangle that are averaged: the middles of 16 equal triangles in it.
_STEPS = 4


def beside(folder: Path, name: str) -> Path | None:
    """Return the file that a model names, if it lies in the model's folder or below it.

    Photogrammetry programs write the path that a picture had on their machine; then the picture
    of that name in the model's folder is meant. Nothing outside the folder is ever opened.
    """
    plain = name.strip().strip('"').replace("\\", "/")
    root = folder.resolve()
    for candidate in (plain, PureWindowsPath(plain).name):
        if not candidate:
            continue
        try:
            path = (folder / candidate).resolve()
            if path.is_relative_to(root) and path.is_file():
                return path
        except (OSError, ValueError, RuntimeError):  # too long, a NUL, links in a circle: no name
            continue
    return None


def picture_of(source: Path | bytes) -> NDArray[np.uint8] | None:
    """Return a picture as (H, W, 3) sRGB, at most ``FINEST`` wide; ``None`` if unreadable."""
    most = Image.MAX_IMAGE_PIXELS
    try:
        Image.MAX_IMAGE_PIXELS = None  # the limit here is our own, on the size that is declared
        with Image.open(io.BytesIO(source) if isinstance(source, bytes) else source) as image:
            width, height = image.size
            size = len(source) if isinstance(source, bytes) else source.stat().st_size
            if not 0 < width * height <= min(MOST_PIXELS, max(FINEST**2, _DENSEST * size)):
                return None
            image.draft("RGB", (FINEST, FINEST))
            factor = max(1, max(image.size) // FINEST)
            small = image.reduce(factor) if factor > 1 and image.mode != "P" else image
            return np.asarray(small.convert("RGB"), np.uint8)
    except (OSError, ValueError, SyntaxError, MemoryError):
        return None
    finally:
        Image.MAX_IMAGE_PIXELS = most


def texture_colours(uv: NDArray[np.float64], picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the mean colour (F, 3) of a picture over triangles.

    Args:
        uv: (F, 3, 2) texture coordinates of the corners, v up, repeated outside 0..1.
        picture: (H, W, 3) sRGB, first row on top.
    """
    height, width = picture.shape[:2]
    total = np.zeros((len(uv), 3), np.uint32)
    corners = np.nan_to_num(uv)
    weights = _middles()
    for weight in weights:
        place = np.einsum("k,fkd->fd", weight, corners)
        column = np.floor(np.mod(place[:, 0], 1.0) * width).astype(np.int64)
        row = np.floor(np.mod(-place[:, 1], 1.0) * height).astype(np.int64)
        total += picture[np.minimum(row, height - 1), np.minimum(column, width - 1)]
    return ((total + len(weights) // 2) // len(weights)).astype(np.uint8)


def _middles() -> NDArray[np.float64]:
    """Barycentric coordinates of the middles of the triangles that one is cut into."""
    found = []
    for i in range(_STEPS):
        for j in range(_STEPS - i):
            found.append(((3 * i + 1) / (3 * _STEPS), (3 * j + 1) / (3 * _STEPS)))
            if i + j < _STEPS - 1:
                found.append(((3 * i + 2) / (3 * _STEPS), (3 * j + 2) / (3 * _STEPS)))
    ab = np.array(found)
    return np.column_stack([ab, 1.0 - ab.sum(axis=1)])
