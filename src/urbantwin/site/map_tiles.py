"""Raster tiles of the Web Mercator grid (EPSG:3857), from a URL or from files.

Tile (0, 0) of zoom z is the north-western of 2^z by 2^z (OGC 17-083r2, WebMercatorQuad).
"""

from __future__ import annotations

import io
import math
import warnings
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from urbantwin.download import Client, DownloadError, Limits, key_for, parse_origin
from urbantwin.errors import InputError
from urbantwin.site.imagery import ImagerySource

__all__ = ["Mosaic", "read_tiles"]

#: Half the width of the grid: pi times the radius of the Earth, metres.
HALF_M = math.pi * 6378137.0
#: Allowed tile sizes, pixels.
SIDES = (256, 512, 1024)
#: Most pixels of a mosaic, and most bytes of one tile.
MOST_PIXELS, MOST_BYTES = 64_000_000, 5_000_000
#: Limits of one tile, of all tiles of a source, and of the total time.
LIMITS = Limits(MOST_BYTES, 1 << 30, 1800.0)
#: Number of parallel requests.
AT_ONCE = 4
#: Most problems listed one by one.
LISTED = 10
#: Number of tiles requested first; at least one of them must be answered.
TRIED_FIRST = 2
UNREACHED = "cannot be fetched"


class _NoPictureError(Exception):
    """Reason why some bytes are not an image of a tile."""


@dataclass(frozen=True, eq=False)
class Mosaic:
    """A mosaic of tiles.

    Attributes:
        pixels: (4, H, W) uint8: red, green, blue, opacity; row 0 is the northernmost.
        west: west edge of the first column, metres, EPSG:3857.
        north: north edge of the first row, metres, EPSG:3857.
        cell_m: pixel size, metres of EPSG:3857.
        problems: tiles that could not be read.
    """

    pixels: NDArray[np.uint8]
    west: float
    north: float
    cell_m: float
    problems: tuple[str, ...]


def read_tiles(
    source: ImagerySource,
    lonlat: NDArray[np.float64],
    environment: Mapping[str, str] | None = None,
    fetch: Callable[[str], bytes] | None = None,
) -> Mosaic:
    """Read the tiles that cover some points.

    Args:
        source: source of the tiles.
        lonlat: (N, 2) points around the area, degrees, WGS84.
        environment: environment variables with the key; the process's own if not given.
        fetch: function that requests a tile's address (with the literal ``{key}``) instead of the
            source; raises DownloadError.

    Raises:
        InputError: the key may not be sent there or is not set, there would be too many tiles, or
            none can be read.
    """
    count = 1 << source.spec.zoom
    xy = (mercator(lonlat) / HALF_M * [1, -1] + 1) / 2 * count
    low = np.floor(xy.min(axis=0)).astype(int)
    high = np.floor(xy.max(axis=0)).astype(int) + 1
    columns, rows = (int(n) for n in high - low)
    if columns * rows * SIDES[0] ** 2 > MOST_PIXELS:
        raise source.document.error(
            f"is {source.spec.zoom}: the region is {columns * rows} tiles",
            ("imagery", source.number, "zoom"),
            f"a lower one, of at most {MOST_PIXELS // SIDES[0] ** 2} tiles",
        )
    if fetch is None:
        is_web = source.is_web
        fetch = _from_web(source, _key(source, environment)) if is_web else _from_files(source)
    places = [(x, y) for y in range(low[1], high[1]) for x in range(low[0], high[0])]
    with warnings.catch_warnings():
        warnings.simplefilter("error", Image.DecompressionBombWarning)
        tile = partial(_tile, source, fetch)
        found = [tile(place) for place in places[:TRIED_FIRST]]
        if any(not isinstance(one, str) or UNREACHED not in one for one in found):
            with ThreadPoolExecutor(AT_ONCE) as pool:
                rest = places[TRIED_FIRST:]
                found += pool.map(tile, rest)
        else:  # without a response, every tile would time out
            found += [f"{UNREACHED} either"] * (len(places) - len(found))
    pictures = [one for one in found if not isinstance(one, str)]
    problems = [one for one in found if isinstance(one, str)]
    if not pictures:
        raise InputError(
            f"no tile of {source.name} can be read ({problems[0]})",
            file=source.document.file,
            place=source.place("xyz"),
            expected="tiles of the region",
        )
    side = max(len(one) for one in pictures)
    if columns * rows * side**2 > MOST_PIXELS:
        side = SIDES[0]
    pixels = np.zeros((4, rows * side, columns * side), np.uint8)
    for (x, y), one in zip(places, found, strict=True):
        if not isinstance(one, str):
            whole = Image.fromarray(one).resize((side, side), Image.Resampling.BOX)
            i, j = (y - low[1]) * side, (x - low[0]) * side
            pixels[:, i : i + side, j : j + side] = np.moveaxis(np.asarray(whole), 2, 0)
    more = len(problems) - LISTED
    listed = problems[:LISTED] + ([f"and {more} more"] if more > 0 else [])
    tile_m = 2 * HALF_M / count
    return Mosaic(
        pixels, low[0] * tile_m - HALF_M, HALF_M - low[1] * tile_m, tile_m / side, tuple(listed)
    )


def mercator(lonlat: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return x, y (N, 2) in EPSG:3857 of longitude and latitude (N, 2) in degrees."""
    angle = np.radians(np.clip(lonlat, [-180, -85.06], [180, 85.06]))
    y = np.arcsinh(np.tan(angle[:, 1]))
    return np.column_stack([angle[:, 0], y]) * 6378137.0


def _key(source: ImagerySource, environment: Mapping[str, str] | None) -> str:
    name = source.spec.key_env
    if name is None:
        return ""
    file, place = source.document.file, source.place("key_env")
    value = key_for(name, source.spec.xyz or "", environment, file=file, place=place)
    if not value:
        raise InputError(
            f"the environment variable {name} is not set",
            file=file,
            place=place,
            expected="the key of the tiles' address",
        )
    return value


def _tile(
    source: ImagerySource, fetch: Callable[[str], bytes], place: tuple[int, int]
) -> NDArray[np.uint8] | str:
    """Return a tile's pixels (S, S, 4), or its problem.

    Raises:
        InputError: the download limit is exhausted.
    """
    zoom, (x, y) = source.spec.zoom, place
    address = (source.spec.xyz or "").replace("{z}", str(zoom)).replace("{x}", str(x))
    address = address.replace("{-y}", str((1 << zoom) - 1 - y)).replace("{y}", str(y))
    try:
        return _decoded(fetch(address))
    except DownloadError as error:
        if error.spent:
            raise source.document.error(
                str(error),
                ("imagery", source.number, "xyz"),
                "a lower zoom, a smaller region, or a server that is faster",
            ) from None
        problem = str(error) if error.status is None else f"not there (status {error.status})"
    except FileNotFoundError:
        problem = "not found"
    except OSError:
        problem = UNREACHED
    except _NoPictureError as error:
        problem = str(error)
    return f"tile {zoom}/{x}/{y}: {problem}"


def _decoded(data: bytes) -> NDArray[np.uint8]:
    if len(data) > MOST_BYTES:
        raise _NoPictureError(f"more than {MOST_BYTES} bytes")
    try:
        with Image.open(io.BytesIO(data), formats=("PNG", "JPEG", "WEBP")) as picture:
            if picture.size not in [(side, side) for side in SIDES]:
                raise _NoPictureError(f"{picture.size[0]} x {picture.size[1]} pixels")
            return np.asarray(picture.convert("RGBA"))
    except _NoPictureError:
        raise
    except Exception:
        # Decoders raise various exceptions: OSError, SyntaxError, struct.error, ...
        raise _NoPictureError("not an image") from None


def _from_web(source: ImagerySource, key: str) -> Callable[[str], bytes]:
    """Return a function that downloads a tile, given its address with the literal ``{key}``."""
    pattern = source.spec.xyz or ""
    inside = "{key}" in pattern
    client = Client(
        pattern,
        LIMITS,
        origins=[parse_origin(text) for text in source.spec.origins],
        key=None if inside or not key else key,
        secrets=[key] if inside else [],
    )
    return lambda address: client.get(address.replace("{key}", quote(key, safe="")))


def _from_files(source: ImagerySource) -> Callable[[str], bytes]:
    """Return a function that reads a tile, given its path beside ``site.yaml``."""
    folder = source.document.file.parent

    def read(name: str) -> bytes:
        with (folder / name).open("rb") as stream:
            return stream.read(MOST_BYTES + 1)

    return read
