"""Land cover from imagery: grass, soil, concrete, dark and light asphalt.

Colours are classified by chroma (each colour's share of the light), relative to the asphalt of the
same picture, so neither the camera's white balance nor a shadow changes the result. Grey materials
are classified by brightness, also relative to the asphalt, and only outside shadows. Areas that are
much darker, or darker and bluer (lit only by the sky), keep their material. A dark piece of road is
in a shadow if the ground beside it is dark too, and otherwise it is dark asphalt.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, distance_transform_edt, label, uniform_filter

from urbantwin.scene.ground_material.paint_in_picture import LINEAR
from urbantwin.scene.ground_material.visible_ground import CARRIAGEWAY, FOOTWAY, OPEN
from urbantwin.taxonomy import material_id

__all__ = ["COVERS", "covers_in_picture", "means"]

_Scalar = TypeVar("_Scalar", bound=np.generic)

#: Classes of cover; other ground keeps its material.
COVERS = ("grass", "soil", "concrete", "asphalt", "asphalt-dark", "asphalt-light")
#: Green against red and blue, and red against blue, relative to asphalt's.
GREEN, BROWN = 0.025, 0.06
#: Limits of brightness relative to asphalt: minimum of concrete and light asphalt, maximum of dark.
CONCRETE, LIGHT, DARK = 1.45, 1.3, 0.78
#: Shadow: brightness below the first, or below the second and bluer by the third.
SHADOW, BLUISH, BLUER = 0.5, 0.85, 0.015
#: Ground within this distance of a dark piece of road, metres, determines whether the piece is in a
#: shadow: if this share of it is darker than this factor times its usual brightness.
BESIDE_M, SHARE, DARKER = 2.0, 0.5, 0.6
#: Dark pieces at most twice this apart are joined, metres.
JOINED_M = 0.6
#: Radius within which the most frequent cover is used, metres.
AROUND_M = 1.25
#: Percentile of the brightness of carriageways that represents lit asphalt of the usual kind.
LIT = 60.0


def means(
    rgb: NDArray[np.uint8], good: NDArray[np.bool_], factor: int
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return linear light (ny, nx, 3), averaged over blocks of pixels, and where most are good."""
    ny, nx = (n // factor for n in good.shape)
    out = np.zeros((ny, nx, 3), np.float32)
    count = _blocks(good, factor).sum(axis=(1, 3))
    for k in range(3):
        light = np.where(good, LINEAR[rgb[..., k]], np.float32(0))
        out[..., k] = _blocks(light, factor).sum(axis=(1, 3)) / np.maximum(count, 1)
    return out, count * 2 > factor**2


def _blocks(values: NDArray[_Scalar], factor: int) -> NDArray[_Scalar]:
    ny, nx = (n // factor for n in values.shape)
    return values[: ny * factor, : nx * factor].reshape(ny, factor, nx, factor)


def covers_in_picture(
    light: NDArray[np.float32],
    known: NDArray[np.bool_],
    zone: NDArray[np.uint8],
    cell_m: float,
) -> NDArray[np.uint8]:
    """Return the number of the material (ny, nx) of every cell; 0 where it cannot be classified.

    Args:
        light: (ny, nx, 3) linear light, without paint.
        known: True where there is a picture.
        zone: use of the ground (``seen``), 0 where it is hidden.
        cell_m: side of a cell, metres.
    """
    known = known & (zone > 0)
    road = known & (zone == CARRIAGEWAY)
    total = light[..., 0] + light[..., 1] + light[..., 2]
    chroma = light / np.maximum(total, np.float32(1e-4))[..., None]
    if road.sum() * cell_m**2 > 20.0:
        grey = np.median(chroma[road], axis=0)
        usual = float(np.percentile(total[road], LIT))
    else:  # There is no road to compare with.
        grey = np.full(3, 1 / 3, np.float32)
        usual = float(np.median(total[known])) if known.any() else 1.0
    off = chroma - grey
    bright = total / max(usual, 1e-4)
    green = off[..., 1] - (off[..., 0] + off[..., 2]) / 2 > GREEN
    brown = ~green & (off[..., 0] - off[..., 2] > BROWN)
    shadow = (bright < BLUISH) & (off[..., 2] > BLUER)
    shadow |= (bright < SHADOW) & (zone != CARRIAGEWAY)
    kinds = [known & (zone == FOOTWAY), *(known & (zone == OPEN) & c for c in (green, brown))]
    kinds.append(known & (zone == OPEN) & ~green & ~brown)
    dim = _darker_than_usual(total, kinds)
    shadow |= _shaded_pieces(road & ~shadow & (bright < DARK), dim, kinds, cell_m)
    plain = ~green & ~brown & ~shadow
    found = np.zeros(zone.shape, np.uint8)

    def put(name: str, where: NDArray[np.bool_]) -> None:
        found[where & known] = material_id(name)

    put("grass", green & (zone != CARRIAGEWAY))
    put("soil", brown & (zone == OPEN))
    put("concrete", plain & (zone == OPEN) & (bright > CONCRETE))
    put("asphalt", plain & (zone == OPEN) & (bright <= CONCRETE))
    put("asphalt", plain & (zone == FOOTWAY) & (bright < 1.1))
    put("asphalt-light", plain & road & (bright > LIGHT))
    put("asphalt-dark", plain & road & (bright < DARK))
    put("asphalt", plain & road & (bright >= DARK) & (bright <= LIGHT))
    return _most_frequent(found, zone, cell_m)


def _darker_than_usual(
    total: NDArray[np.float32], kinds: list[NDArray[np.bool_]]
) -> NDArray[np.bool_]:
    """Return where ground is much darker than most of its kind."""
    dim = np.zeros(total.shape, bool)
    for kind in kinds:
        if kind.any():
            dim |= kind & (total < DARKER * np.percentile(total[kind], LIT))
    return dim


def _shaded_pieces(
    dark: NDArray[np.bool_],
    dim: NDArray[np.bool_],
    kinds: list[NDArray[np.bool_]],
    cell_m: float,
) -> NDArray[np.bool_]:
    """Return the connected pieces of dark road next to which other ground is dark too.

    Lane markings, which are not classified here, do not split them.
    """
    if not dark.any():
        return dark
    reach = max(1, round(JOINED_M / cell_m))
    joined = binary_dilation(dark, np.ones((3, 3), bool), iterations=reach)
    number, count = label(joined, np.ones((3, 3), bool))
    distance, nearest = distance_transform_edt(~dark, return_indices=True)
    beside = (distance * cell_m <= BESIDE_M) & np.logical_or.reduce(kinds)
    owner = number[nearest[0][beside], nearest[1][beside]]
    around = np.bincount(owner, minlength=count + 1)
    shaded = np.bincount(owner, dim[beside], minlength=count + 1)
    in_shadow = (shaded > SHARE * around) & (around > 0)
    in_shadow[0] = False
    return np.asarray(in_shadow[number] & dark)


def _most_frequent(
    found: NDArray[np.uint8], zone: NDArray[np.uint8], cell_m: float
) -> NDArray[np.uint8]:
    """Return the most frequent material in the neighbourhood within the same zone."""
    size = max(3, 2 * round(AROUND_M / cell_m / 2) + 1)
    best, most = np.zeros(found.shape, np.uint8), np.zeros(found.shape, np.float32)
    for kind in (CARRIAGEWAY, FOOTWAY, OPEN):
        here = zone == kind
        for number in np.unique(found[here]):
            share = uniform_filter((here & (found == number)).astype(np.float32), size)
            better = here & (share > most + 1e-6)
            best[better], most[better] = number, share[better]
    return best
