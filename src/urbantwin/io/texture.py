"""Images mapped onto triangles, and their mean colours."""

from __future__ import annotations

import io
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path, PureWindowsPath

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from urbantwin.io.values import MalformedError

__all__ = ["Texture", "beside", "open_image", "picture_of", "srgb_from_linear", "texture_colours"]

#: Maximum side of images after reduction, pixels.
FINEST = 2048
#: Maximum number of pixels of an image.
MOST_PIXELS = 20_000 * 20_000
#: Maximum number of pixels per byte of a file; files that claim more are rejected.
_DENSEST = 1100
#: Divisions of a side: colours are averaged over the centres of 16 equal triangles.
_STEPS = 4


def beside(folder: Path, name: str) -> Path | None:
    """Return the file that a model names, if it is in the model's folder or below it.

    Photogrammetry programs write the path of an image on their machine; then the image of that name
    in the model's folder is used. No file outside the folder is opened.
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
        except (OSError, ValueError, RuntimeError):  # too long, a NUL, or a loop of links
            continue
    return None


def picture_of(source: Path | bytes) -> NDArray[np.uint8] | None:
    """Return an image as (H, W, 3) sRGB, at most ``FINEST`` wide; ``None`` if unreadable."""
    most = Image.MAX_IMAGE_PIXELS
    try:
        Image.MAX_IMAGE_PIXELS = None  # our own limit applies to the declared size
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
    """Return the mean colour (F, 3) of an image over triangles.

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
    """Return barycentric coordinates of the centres of the parts of a triangle."""
    found = []
    for i in range(_STEPS):
        for j in range(_STEPS - i):
            found.append(((3 * i + 1) / (3 * _STEPS), (3 * j + 1) / (3 * _STEPS)))
            if i + j < _STEPS - 1:
                found.append(((3 * i + 2) / (3 * _STEPS), (3 * j + 2) / (3 * _STEPS)))
    ab = np.array(found)
    return np.column_stack([ab, 1.0 - ab.sum(axis=1)])


#: Maximum number of pixels and maximum side of an image.
_MOST_PIXELS, _LONGEST = 1 << 28, 1 << 15
#: Side to which larger images are reduced: sufficient for a triangle's mean.
_SIDE = 2048
_REPEAT, _CLAMP, _MIRROR = 10497, 33071, 33648
_CHUNK = 1 << 18


@lru_cache(maxsize=1)
def _linear_of_byte() -> NDArray[np.float32]:
    return linear_from_srgb(np.arange(256) / 255.0).astype(np.float32)


def linear_from_srgb(value: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return linear light, 0..1, of sRGB values, 0..1 (IEC 61966-2-1)."""
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def srgb_from_linear(value: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return sRGB bytes of linear light, 0..1 (IEC 61966-2-1)."""
    v = np.clip(value, 0.0, 1.0)
    srgb = np.where(v <= 0.0031308, v * 12.92, 1.055 * v ** (1 / 2.4) - 0.055)
    return np.rint(srgb * 255.0).astype(np.uint8)


def open_image(data: bytes) -> NDArray[np.uint8]:
    """Return (H, W, 4) RGBA pixels, reduced to at most 2048 per side.

    Raises:
        MalformedError: not an image that Pillow reads, or too large.
    """
    usual = Image.MAX_IMAGE_PIXELS
    try:
        # Photogrammetry uses 16384 x 16384, which Pillow rejects as an attack.
        Image.MAX_IMAGE_PIXELS = None
        picture = Image.open(io.BytesIO(data))
        claimed = picture.size
        # A JPEG is decoded at down to an eighth of its size if that suffices.
        picture.draft("RGB", (_SIDE, _SIDE))
        if max(claimed) > _LONGEST or picture.width * picture.height > _MOST_PIXELS:
            raise MalformedError(f"an image claims {claimed[0]} x {claimed[1]} pixels")
        factor = -(-max(picture.size) // _SIDE)
        if factor == 1:
            return np.asarray(picture.convert("RGBA"))
        plain = picture.mode in ("RGB", "RGBA", "L", "LA")
        smaller = (picture if plain else picture.convert("RGBA")).reduce(factor)
        return np.asarray(smaller.convert("RGBA"))
    except MalformedError:
        raise
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError, EOFError, MemoryError):
        raise MalformedError("an image cannot be read") from None
    finally:
        Image.MAX_IMAGE_PIXELS = usual


@dataclass(frozen=True, eq=False)
class Texture:
    """An image and its mapping.

    Attributes:
        pixels: (H, W, 4) uint8 RGBA.
        wrap: modes of u and v, in OpenGL's numbering.
        offset, rotation, scale: of ``KHR_texture_transform``.
    """

    pixels: NDArray[np.uint8]
    wrap: tuple[int, int] = (_REPEAT, _REPEAT)
    offset: tuple[float, float] = (0.0, 0.0)
    rotation: float = 0.0
    scale: tuple[float, float] = (1.0, 1.0)

    def transformed(self, uv: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return texture coordinates (..., 2) after ``KHR_texture_transform``."""
        if self.rotation == 0.0 and self.scale == (1.0, 1.0) and self.offset == (0.0, 0.0):
            return uv
        c, s = np.cos(self.rotation), np.sin(self.rotation)
        scaled = uv * np.array(self.scale)
        turned = scaled @ np.array([[c, -s], [s, c]])
        return np.asarray(turned + np.array(self.offset))

    def texels(self, uv: NDArray[np.float64]) -> NDArray[np.uint8]:
        """Return the nearest texels (..., 4) at coordinates (..., 2), as stored."""
        height, width = self.pixels.shape[:2]
        u = _index(uv[..., 0], width, self.wrap[0])
        v = _index(uv[..., 1], height, self.wrap[1])
        return self.pixels[v, u]

    def means(self, uv: NDArray[np.float64], *, use_alpha: bool) -> NDArray[np.float64]:
        """Return the mean colour (F, 3), linear light, over triangles.

        Args:
            uv: (F, 3, 2) texture coordinates of the corners.
            use_alpha: weight texels by their opacity.
        """
        uv = np.nan_to_num(self.transformed(uv), nan=0.0, posinf=0.0, neginf=0.0)
        height, width = self.pixels.shape[:2]
        a, b = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
        texels = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) * (0.5 * width * height)
        result = np.empty((len(uv), 3))
        few, many = texels <= 16, ~(texels <= 256)
        for count, chosen in ((4, few), (16, ~few & ~many), (256, many)):
            self._fill(result, uv, np.flatnonzero(chosen), count, use_alpha)
        return result

    def _fill(
        self,
        result: NDArray[np.float64],
        uv: NDArray[np.float64],
        chosen: NDArray[np.int64],
        count: int,
        use_alpha: bool,
    ) -> None:
        weights, linear = _spread(count), _linear_of_byte()
        step = max(1, _CHUNK // len(weights))
        for start in range(0, len(chosen), step):
            some = chosen[start : start + step]
            rgba = self.texels(np.einsum("sk,fkc->fsc", weights, uv[some]))
            light = linear[rgba[..., :3]]
            if use_alpha:
                opacity = rgba[..., 3].astype(np.float32)
                total = opacity.sum(axis=1, keepdims=True)
                share = np.where(total > 0, opacity / np.maximum(total, 1), 1 / len(weights))
                result[some] = np.einsum("fs,fsc->fc", share, light)
            else:
                result[some] = light.mean(axis=1)


def _index(value: NDArray[np.float64], size: int, wrap: int) -> NDArray[np.int64]:
    """Return texel numbers of one texture coordinate."""
    at = np.floor(np.clip(value, -1e9, 1e9) * size).astype(np.int64)
    if wrap == _CLAMP:
        return np.clip(at, 0, size - 1)
    if wrap == _MIRROR:
        at = np.mod(at, 2 * size)
        return np.where(at >= size, 2 * size - 1 - at, at)
    return np.mod(at, size)


@lru_cache(maxsize=4)
def _spread(count: int) -> NDArray[np.float64]:
    """Return barycentric weights (count, 3) of points spread over a triangle.

    Four are the centres of its quarters. More follow the R2 sequence (M. Roberts 2018, "The
    Unreasonable Effectiveness of Quasirandom Sequences"), folded into the triangle: a regular
    lattice would alias with repeating textures.
    """
    if count == 4:
        u = np.array([1 / 6, 1 / 6, 2 / 3, 1 / 3])
        v = np.array([1 / 6, 2 / 3, 1 / 6, 1 / 3])
    else:
        golden = 1.32471795724474602596
        number = np.arange(1, count + 1)
        u, v = np.mod(0.5 + number / golden, 1.0), np.mod(0.5 + number / golden**2, 1.0)
        outside = u + v > 1
        u, v = np.where(outside, 1 - u, u), np.where(outside, 1 - v, v)
    return np.stack([1 - u - v, u, v], axis=1)
