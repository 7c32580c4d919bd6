"""Elevation: cloud-optimised GeoTIFFs by range requests, cut-outs of services, terrain tiles."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from urbantwin.acquire.area import Area
from urbantwin.acquire.file_index import filled, located_files
from urbantwin.acquire.map_pictures import tile_mosaic
from urbantwin.acquire.raster_window import (
    HeightWindow,
    cut_heights,
    remote_raster,
    write_heights,
)
from urbantwin.acquire.remote_file import RemoteFile
from urbantwin.acquire.source import MARGIN_M, AcquiredInput
from urbantwin.acquire.source_table import SourceSpec
from urbantwin.acquire.web import NotAcquiredError, NothingThereError, Web
from urbantwin.download import DownloadError
from urbantwin.errors import InputError
from urbantwin.progress import Progress
from urbantwin.site.geotiff import opened_geotiff

__all__ = ["fetch_cog", "fetch_geotiff", "fetch_terrain_tiles"]

NAME = "elevation.tif"
#: Most cells per side requested from a service.
_MOST_SIDE = 6000


def fetch_cog(
    spec: SourceSpec, area: Area, web: Web, folder: Path, progress: Progress
) -> AcquiredInput:
    """Write heights of cloud-optimised GeoTIFFs, reading only the blocks around an area."""
    server = web.server(spec)
    addresses = located_files(server, spec, area)
    windows: list[HeightWindow] = []
    missing: DownloadError | None = None
    times, read = [], []
    for number, address in enumerate(addresses):
        progress(number / len(addresses), f"{spec.name}: {address.rpartition('/')[2]:.60}")
        try:
            file = RemoteFile(server, address)
        except DownloadError as error:
            if error.status not in (403, 404, 410):
                raise
            missing = error  # there are no tiles of the sea
            continue
        with remote_raster(file) as raster:
            window = cut_heights(raster, area)
        if window is not None:
            windows.append(window)
            times.append(file.at)
            read.append(server.shown(address))
        if spec.index is not None and windows and _is_full(windows[-1], area):
            break
    if not windows:
        raise missing or NothingThereError()
    crs = write_heights(windows, folder / NAME, area, spec.crs)
    return _input(spec, folder, read[0], min(times), crs)


def fetch_geotiff(
    spec: SourceSpec, area: Area, web: Web, folder: Path, progress: Progress
) -> AcquiredInput:
    """Write the heights that a service cuts out for a box (WCS, OpenTopography)."""
    server = web.server(spec)
    progress(0.0, f"{spec.name}: asking")
    address = filled(spec.address, _box_values(spec, area))
    told = server.get(address)
    scratch = folder / ".answer.tif"
    try:
        scratch.write_bytes(told.data)
        with opened_geotiff(scratch, "heights as GeoTIFF") as raster:
            window = cut_heights(raster, area)
    except InputError as error:
        web.cache.forget(address)
        raise NotAcquiredError(f"answers what {error.problem}") from None
    finally:
        scratch.unlink(missing_ok=True)
    crs = write_heights([window] if window else [], folder / NAME, area, spec.crs)
    return _input(spec, folder, server.shown(address), told.at, crs)


def fetch_terrain_tiles(
    spec: SourceSpec, area: Area, web: Web, folder: Path, progress: Progress
) -> AcquiredInput:
    """Write the heights of terrain tiles: red * 256 + green + blue / 256 - 32768 (Terrarium)."""
    from affine import Affine

    mosaic, server, at = tile_mosaic(spec, area, web, progress)
    red, green, blue, opacity = mosaic.pixels.astype(np.float32)
    heights = red * 256 + green + blue / 256 - 32768
    heights[opacity == 0] = np.nan
    cell = mosaic.cell_m
    transform = Affine(cell, 0, mosaic.west, 0, -cell, mosaic.north)
    window = HeightWindow(heights, transform, _web_mercator())
    crs = write_heights([window], folder / NAME, area, spec.crs)
    return _input(spec, folder, server.shown(spec.address), at, crs)


def _is_full(window: HeightWindow, area: Area) -> bool:
    """Return whether a window has heights in the whole square of the area."""
    west, south, east, north = area.box_in(window.crs, 0.0)
    back = ~window.transform
    corners = [back @ one for one in ((west, south), (east, south), (east, north), (west, north))]
    rows, columns = window.heights.shape
    inside = all(0 <= x <= columns and 0 <= y <= rows for x, y in corners)
    return inside and not np.isnan(window.heights).any()


def _box_values(spec: SourceSpec, area: Area) -> dict[str, object]:
    """Return the placeholder values of a service's address."""
    west, south, east, north = area.box(MARGIN_M)
    values: dict[str, object] = {
        "west": f"{west:.6f}", "south": f"{south:.6f}", "east": f"{east:.6f}",
        "north": f"{north:.6f}",
    }  # fmt: skip
    if spec.crs is not None:
        try:
            x0, y0, x1, y1 = (round(one) for one in area.box_in(spec.crs, MARGIN_M))
        except ValueError:
            raise NothingThereError() from None
        step = spec.resolution_m or 1.0
        values |= {
            "xmin": x0, "ymin": y0, "xmax": x1, "ymax": y1,
            "columns": min(_MOST_SIDE, max(2, round((x1 - x0) / step))),
            "rows": min(_MOST_SIDE, max(2, round((y1 - y0) / step))),
        }  # fmt: skip
    return values


def _input(spec: SourceSpec, folder: Path, url: str, at: str, crs: str) -> AcquiredInput:
    told = f"{spec.resolution_m:g} m" if spec.resolution_m else ""
    return AcquiredInput("elevation", spec, folder / NAME, url, at, told=told, crs=crs)


def _web_mercator() -> str:
    from pyproj import CRS

    return str(CRS.from_epsg(3857).to_wkt())
