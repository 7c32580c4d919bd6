"""A first ``site.yaml`` for an imported road map."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import Transformer

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.progress import Progress, untold
from urbantwin.roads.imported.build import check_meets
from urbantwin.roads.imported.crop import cropped, has_traffic
from urbantwin.roads.imported.junction_proposal import (
    MapJunction,
    busiest_junction,
    paved_area,
    volumes,
)
from urbantwin.roads.imported.read import (
    anchor_of,
    is_placed,
    map_format,
    naming_file,
    placed_map,
    read_map,
)
from urbantwin.roads.model import LaneModel
from urbantwin.roads.opendrive.reading.placement import crs_of
from urbantwin.roads.opendrive.reading.read import ReadMap, read_opendrive
from urbantwin.site.country import country_of
from urbantwin.site.draft import RADIUS_M, GivenPlace, SiteDraft, check_target, write_draft
from urbantwin.site.extract import OsmFeature
from urbantwin.site.extract_file import box_around, read_extract
from urbantwin.site.junction_proposal import titled
from urbantwin.site.pole_site import PoleChoice, PoleGround, features_around, nearest_place
from urbantwin.site.region import circle

__all__ = ["init_site_of_map"]

#: Function from x, y (N, 2) of a map to longitude and latitude (N, 2), degrees.
ToDegrees = Callable[[NDArray[np.float64]], NDArray[np.float64]]

#: Radius of paved corners where streets meet, metres.
CORNER_M = 6.0
#: Roads farther from the anchor do not affect the pole, metres.
AROUND_M = 110.0
#: Decimals of an anchor in degrees and in metres: one centimetre.
DEGREES, METRES = 7, 2


def init_site_of_map(  # noqa: PLR0913 - every one is a person's choice
    folder: Path,
    roads: Path,
    *,
    osm: Path | None = None,
    latitude: float | None = None,
    longitude: float | None = None,
    region: Path | None = None,
    radius_m: float | None = None,
    force: bool = False,
    choose_pole: PoleChoice = nearest_place,
    progress: Progress | None = None,
) -> Path:
    """Write a commented ``site.yaml`` for a road map and return its path.

    Files outside ``folder`` are copied into it, so that the folder is self-contained.

    Args:
        folder: folder to write; created if missing.
        roads: the map.
        osm: an OpenStreetMap extract for the surroundings of the roads.
        latitude: latitude of the anchor, degrees. By default the busiest junction is proposed. For
            a map without georeference that junction is always the anchor, and this gives its
            position; 0 by default.
        longitude: longitude of the anchor, degrees.
        region: a GeoJSON polygon; by default a circle.
        radius_m: radius of the circle; 150 m by default.
        force: replace an existing ``site.yaml``.
        choose_pole: function that places the sensor's pole at the junction.
        progress: called with the completed share (0..1) and the current task.

    Raises:
        InputError: a file or the region is invalid, the place is not on the map, or there already
            is a ``site.yaml``.
    """
    check_target(folder, force=force)
    place = GivenPlace.checked(latitude, longitude, region, radius_m)
    read = read_opendrive(roads) if map_format(roads) == "OpenDRIVE" else None
    frame, anchor_m, junction = _anchor(roads, read, place)
    if read is None:
        imported = read_map(roads, frame, anchor_m)
    else:
        imported = placed_map(roads, read, frame, anchor_m)
    radius = RADIUS_M if radius_m is None else radius_m
    shape = place.region(frame, radius)
    check_meets(imported, shape)
    features = _features(osm, frame, shape, progress or untold) if osm else []
    around = cropped(imported.model, circle(AROUND_M))
    paved = paved_area(around).buffer(CORNER_M).buffer(-CORNER_M)
    country = country_of(frame.latitude, frame.longitude) if anchor_m is None else ""
    draft = SiteDraft(
        title=titled(junction.names) or roads.name.split(".")[0],
        why=_anchor_comment(junction, anchor_m, given=place.point is not None),
        latitude=frame.latitude,
        longitude=frame.longitude,
        region=radius if region is None else region,
        osm=osm,
        roads=roads,
        anchor_m=anchor_m,
        per_hour=volumes(imported.model, shape, country),
        pole=choose_pole(PoleGround(paved, paved, shape, features)),
    )
    return write_draft(folder, draft, force=force)


def _features(
    osm: Path, frame: SiteFrame, region: shapely.Polygon, tell: Progress
) -> list[OsmFeature]:
    extract = read_extract(osm, box_around(frame, region), progress=tell)
    return features_around(extract, frame)


def _anchor(
    path: Path,
    read: ReadMap | None,
    given: GivenPlace,
) -> tuple[SiteFrame, tuple[float, float] | None, MapJunction]:
    """Return the site frame, the anchor in the map's x, y if needed, and the junction."""
    model, degrees = _on_earth(path, read, given.point)
    if not has_traffic(model):
        raise InputError(
            "holds no lanes that traffic could use",
            file=path,
            expected="roads with lanes of the type driving",
        )
    chosen = _junction(path, model, degrees, given.polygon)
    if degrees is None:
        x, y = (round(value, METRES) for value in chosen.place)
        return SiteFrame(*(given.point or (0.0, 0.0))), (x, y), chosen
    if given.point is not None:
        return SiteFrame(*given.point), None, chosen
    longitude, latitude = degrees(np.array([chosen.place]))[0]
    if not np.isfinite([longitude, latitude]).all():
        raise InputError("lies where its georeference does not hold", file=path)
    return (
        SiteFrame(round(float(latitude), DEGREES), round(float(longitude), DEGREES)),
        None,
        chosen,
    )


def _on_earth(
    path: Path, read: ReadMap | None, given: tuple[float, float] | None
) -> tuple[LaneModel, ToDegrees | None]:
    """Return a map in its own coordinates, and their conversion to degrees if georeferenced."""
    if read is None:
        placed = is_placed(path)
        frame = SiteFrame(*(anchor_of(path) if placed else given or (0.0, 0.0)))
        return read_map(path, frame).model, frame.lonlat_from_site if placed else None
    if read.projection is None:
        return read.model, None
    with naming_file(path):
        transformer = Transformer.from_crs(crs_of(read.projection), "EPSG:4326", always_xy=True)

    def degrees(xy: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.column_stack(transformer.transform(xy[:, 0], xy[:, 1]))

    return read.model, degrees


def _junction(
    path: Path, model: LaneModel, degrees: ToDegrees | None, polygon: shapely.Polygon | None
) -> MapJunction:
    def within(place: NDArray[np.float64]) -> bool:
        assert degrees is not None
        assert polygon is not None
        return bool(polygon.contains(shapely.Point(degrees(place[None])[0])))

    junction = busiest_junction(model, within if polygon is not None and degrees else None)
    if junction is None:
        raise InputError(
            "has no junction in the region",
            file=path,
            expected="roads that meet there, or a latitude and longitude",
        )
    return junction


def _anchor_comment(
    found: MapJunction, anchor_m: tuple[float, float] | None, *, given: bool
) -> str:
    kind = "signalised " if found.signals else ""
    lights = f"{found.signals} signals" if found.signals else "no signals on this map"
    busiest = f"The busiest {kind}junction of the map: {found.arms} roads meet, {lights}."
    if anchor_m is None:
        return "As given." if given else busiest
    place_text = "It lies where you said" if given else "0, 0 is assumed: put in where it is"
    return f"{busiest}\n# The map does not say where on earth it lies. {place_text}."
