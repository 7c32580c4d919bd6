"""Map tiles of the Web Mercator grid: aerial imagery, and other pixels."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from urbantwin.acquire.answer_cache import now
from urbantwin.acquire.area import Area
from urbantwin.acquire.source import MARGIN_M, AcquiredInput
from urbantwin.acquire.source_table import SourceSpec
from urbantwin.acquire.web import NotAcquiredError, Server, Web
from urbantwin.errors import InputError
from urbantwin.progress import Progress
from urbantwin.site.imagery import ImagerySource, ImagerySpec
from urbantwin.site.map_tiles import Mosaic, read_tiles
from urbantwin.site.yaml_document import Document

__all__ = ["fetch_pictures", "name_tileset", "tile_mosaic"]


def name_tileset(
    spec: SourceSpec, area: Area, web: Web, folder: Path, progress: Progress
) -> AcquiredInput:
    """Return a reference to a tileset without fetching it, since providers forbid storing tiles."""
    server = web.server(spec)  # checks the key
    if web.offline:
        raise NotAcquiredError("is fetched during the build, which is not possible with --offline")
    fields = {"url": spec.address}
    if spec.key_env is not None:
        fields["key_env"] = spec.key_env
    told = "asked during the build"
    return AcquiredInput("tiles", spec, None, server.shown(spec.address), now(), fields, told)


#: Largest fraction of missing tiles of a picture.
_MOST_MISSING = 0.25


def fetch_pictures(
    spec: SourceSpec, area: Area, web: Web, folder: Path, progress: Progress
) -> AcquiredInput:
    """Write an aerial picture of an area, as one GeoTIFF of its tiles."""
    from affine import Affine
    from rasterio.io import MemoryFile

    mosaic, server, at = tile_mosaic(spec, area, web, progress)
    if np.ptp(mosaic.pixels[:3].reshape(3, -1), axis=1).max() == 0:
        raise NotAcquiredError("shows one colour there, and no ground")
    path = folder / "imagery.tif"
    bands, rows, columns = mosaic.pixels.shape
    profile = {
        "driver": "GTiff", "dtype": "uint8", "count": bands, "height": rows, "width": columns,
        "transform": Affine(mosaic.cell_m, 0, mosaic.west, 0, -mosaic.cell_m, mosaic.north),
        "crs": "EPSG:3857", "compress": "deflate", "predictor": 2, "photometric": "RGB",
        "alpha": "unassociated", "tiled": True,
    }  # fmt: skip
    with MemoryFile() as file:
        with file.open(**profile) as written:
            written.write(mosaic.pixels)
        path.write_bytes(file.read())
    return AcquiredInput(
        "imagery", spec, path, server.shown(spec.address), at, told=f"{columns} x {rows} pixels"
    )


def tile_mosaic(
    spec: SourceSpec, area: Area, web: Web, progress: Progress
) -> tuple[Mosaic, Server, str]:
    """Return a source's tiles around an area, its server, and the time of the oldest tile.

    Raises:
        NotAcquiredError: the tiles cannot be fetched, or are too many.
    """
    server = web.server(spec)
    times: list[str] = []

    def fetch(address: str) -> bytes:
        told = server.get(address)
        times.append(told.at)
        progress(min(0.95, len(times) / 200), f"{spec.name}: tile {len(times)}")
        return told.data

    tiles = ImagerySource(
        ImagerySpec(xyz=spec.address, zoom=spec.zoom or 10, key_env=spec.key_env),
        Document(Path("sources.yaml"), {}),
        0,
    )
    try:
        mosaic = read_tiles(tiles, area.outline(MARGIN_M), fetch=fetch)
    except InputError as error:
        raise NotAcquiredError(server.hidden(error.problem)) from None
    if (mosaic.pixels[3] == 0).mean() > _MOST_MISSING:
        reason = f" ({mosaic.problems[0]})" if mosaic.problems else ""
        raise NotAcquiredError(f"lacks too many tiles there{server.hidden(reason)}")
    return mosaic, server, min(times)
