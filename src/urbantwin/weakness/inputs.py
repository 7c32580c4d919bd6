"""Findings about a site's other inputs: elevation, imagery, extract, rig, traffic, terms."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from datetime import UTC, datetime

import numpy as np
import shapely
from pyproj import Transformer

from urbantwin.geometry import SiteFrame
from urbantwin.site import ImagerySource, Site, read_heights
from urbantwin.site.extract_coverage import small_features
from urbantwin.site.geotiff import opened_geotiff
from urbantwin.weakness.finding import Finding, counted, finding, spot
from urbantwin.weakness.mapped_site import MappedSite

__all__ = ["extract_findings", "input_findings", "look_at_picture"]

#: Cell size of elevation models, and pixel size of imagery, above which they are coarse, metres.
COARSE_DEM_M, COARSE_IMAGE_M = 5.0, 0.35
#: Mapped share of a region below which it extends beyond its map.
_MIN_MAPPED_SHARE = 0.995
#: Number of small features below which the end of a map is unknown, unless it covers less than this
#: share of the region.
_MIN_SMALL_FEATURES, _MIN_GUESSED_SHARE = 100, 1 / 3
#: Pixel size of web tiles at zoom 0 on the equator, metres.
_TILE_M = 156543.034
#: TIFF tags with the date of acquisition, the most reliable first; of GDAL and of TIFF 6.0.
_DATE_TAGS = ("ACQUISITIONDATETIME", "TIFFTAG_DATETIME")


def input_findings(site: Site, map_date: datetime | None) -> Iterator[Finding]:
    """Yield the findings about inputs other than the map.

    Args:
        site: the site as written.
        map_date: date of the map, if known.
    """
    yield from _elevation(site)
    yield from _imagery(site, map_date)
    proposed = [sensor for sensor in site.rig.sensors if sensor.proposed]
    if proposed:
        count, of = len(proposed), len(site.rig.sensors)
        yield finding(
            "sensors-proposed",
            counted(count, "sensor stands", "sensors stand")
            + " where nobody chose: "
            + ", ".join(sensor.name for sensor in proposed),
            share=count / of,
            count=count,
            of=of,
            spots=[
                spot(
                    site.frame,
                    shapely.Point(sensor.east_m, sensor.north_m),
                    name=f"sensor {sensor.name}",
                )
                for sensor in proposed
                if sensor.east_m is not None and sensor.north_m is not None
            ],
            where="rig.sensors",
        )
    if site.traffic.guessed:
        problem = "how many come per hour is guessed"
        yield finding("traffic-guessed", problem, where="traffic.per_hour")
    yield from _terms(site)


def extract_findings(place: MappedSite) -> Iterator[Finding]:
    """Yield a finding if the extract does not cover the region."""
    covered = float(shapely.intersection(place.area, place.region).area / place.region.area)
    # Without bounds in the file its end is estimated from small features.
    sure = place.extract.bounds is not None
    many = sure or len(small_features(place.extract, place.frame)) >= _MIN_SMALL_FEATURES
    if covered >= _MIN_MAPPED_SHARE or not (many or covered < _MIN_GUESSED_SHARE):
        return
    beyond = shapely.difference(place.region, place.area)
    parts = sorted(shapely.get_parts(beyond), key=lambda part: -part.area)
    yield finding(
        "extract-ends",
        f"the extract {'ends' if sure else 'seems to end'} within the region: "
        f"{100 * (1 - covered):.0f} % of it {'lies' if sure else 'or more lie'} beyond",
        share=(1.0 - covered) * (1.0 if sure else 0.6),
        count=len(parts),
        spots=[spot(place.frame, part, name="beyond the map") for part in parts[:4]],
        where="region",
    )


def _elevation(site: Site) -> Iterator[Finding]:
    if site.dem is None:
        problem, share = "there is no elevation model", 1.0
        if site.geometry:
            problem, share = f"{problem}; the ground is that of the geometry", 0.3
        yield finding("dem-missing", problem, share=share, where="dem")
        return
    cell_m = read_heights(site.dem.path, site.frame, site.region).source_step_m
    if cell_m > COARSE_DEM_M:
        yield finding(
            "dem-coarse",
            f"a cell of the elevation model is {cell_m:.0f} m wide",
            share=min(1.0, cell_m / 30.0) * (0.5 if site.geometry else 1.0),
            where="dem",
        )


def _imagery(site: Site, map_date: datetime | None) -> Iterator[Finding]:
    if not site.imagery:
        yield finding("imagery-missing", "there is no imagery", where="imagery")
        return
    for source in site.imagery:
        where = f"imagery[{source.number}]"
        date = None
        pixel = _TILE_M * math.cos(math.radians(site.latitude)) / 2**source.spec.zoom
        if source.path is not None:
            date, pixel = look_at_picture(source, site.frame)
        if pixel > COARSE_IMAGE_M:
            problem = f"a pixel of {source.name} is {pixel:.2f} m wide"
            yield finding("imagery-coarse", problem, where=where)
        if date is not None and map_date is not None and date < map_date:
            years = (map_date - date).days / 365.25
            if years >= 0.5:
                yield finding(
                    "imagery-old",
                    f"{source.name} is of {date:%Y-%m-%d}, {years:.1f} years older than the map",
                    share=min(1.0, years / 5.0),
                    where=where,
                )


def look_at_picture(source: ImagerySource, frame: SiteFrame) -> tuple[datetime | None, float]:
    """Return a GeoTIFF's date, if known, and the width of its pixels, metres.

    Raises:
        InputError: it is no GeoTIFF, or damaged.
    """
    assert source.path is not None
    with opened_geotiff(source.path, "a GeoTIFF of red, green and blue") as raster:
        tags = {**raster.tags(), **raster.tags(ns="IMAGERY")}
        date = next((day for key in _DATE_TAGS if (day := _date(tags.get(key, "")))), None)
        crs = source.spec.crs or (raster.crs and raster.crs.to_wkt())
        if not crs:
            return date, 0.0
        middle = (raster.width / 2, raster.height / 2)
        ends = np.array([raster.transform @ (middle[0] + step, middle[1]) for step in (0.0, 1.0)])
        plan = Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
        first, second = frame.site_from_lonlat(np.column_stack(plan.transform(*ends.T)))
        pixel = float(np.linalg.norm(second - first))
    return date, pixel if math.isfinite(pixel) else 0.0


def _date(text: str) -> datetime | None:
    """Return the day of a time in TIFF (``2019:07:01 10:00:00``) or ISO 8601 format."""
    match = re.match(r"\s*(\d{4})[:-](\d{2})[:-](\d{2})", text)
    try:
        return match and datetime(int(match[1]), int(match[2]), int(match[3]), tzinfo=UTC)
    except ValueError:
        return None


def _terms(site: Site) -> Iterator[Finding]:
    unstated = [
        item["name"]
        for item in site.inputs()
        if "not stated" in (item["licence"], item["attribution"])
    ]
    if unstated:
        yield finding(
            "licence",
            f"the terms of {', '.join(unstated)} are not stated",
            count=len(unstated),
            where=unstated[0],
        )
