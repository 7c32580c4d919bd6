"""Railway and tram tracks: line, gauge, and height."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Geometry, LineString, Polygon

from urbantwin.number_text import whole_number
from urbantwin.scene.placement import on_ground
from urbantwin.scene.solids import GroundHeight
from urbantwin.site.extract import OsmFeature

__all__ = ["HEAD_M", "Track", "tracks_of"]

#: Standard gauge, and the width of a rail's head (EN 13674: 49E1 67 mm, 60E1 72 mm), metres.
GAUGE_M, HEAD_M = 1.435, 0.07
#: Height of rails above the pavement, so that beams hit them, metres.
PROUD_M = 0.004
#: Height of the rails above the ground on ballast, reached over so many metres from a road.
BALLASTED_M, RISE_M = 0.55, 12.0
RAILWAYS = ("tram", "light_rail", "rail", "narrow_gauge", "subway", "preserved", "funicular")
STEP_M = 2.5


@dataclass(frozen=True, eq=False)
class Track:
    """A piece of track.

    Attributes:
        path: (N, 3) its middle, at the height of the rails' upper edges, site frame.
        gauge: between the inner edges of the rails' heads, metres.
        lift: (N,) how far that is above the ground.
    """

    path: NDArray[np.float64]
    gauge: float
    lift: NDArray[np.float64]


def tracks_of(
    features: Sequence[OsmFeature],
    region: Polygon,
    ride_height: GroundHeight,
    carriageway: Geometry,
    paved: Geometry,
) -> list[Track]:
    """Return the tracks inside a region.

    Trams lie in the pavement unless the map says otherwise; other tracks lie on ballast and come
    down where they cross a road.

    Args:
        features: the map's features.
        region: where.
        ride_height: heights of the ground and of decks that carry rails.
        carriageway: where tracks lie in the pavement.
        paved: squares and the like, where they do, too.
    """
    street = shapely.union(carriageway, paved)
    shapely.prepare(street)
    found = []
    for feature in features:
        tags, line = feature.tags, feature.geometry
        if not _is_track(tags) or not isinstance(line, LineString):
            continue
        for piece in shapely.get_parts(shapely.intersection(line, region)):
            clean = shapely.remove_repeated_points(piece, 0.2)
            if not isinstance(clean, LineString) or clean.length < 0.5:
                continue
            xy = shapely.get_coordinates(shapely.segmentize(clean, STEP_M))
            away = shapely.distance(street, shapely.points(xy))
            if street.is_empty:
                away = np.full(len(xy), np.inf)
            lift = np.full(len(xy), PROUD_M)
            # Tracks on bridges are fixed to the deck.
            if not _is_embedded(tags) and tags.get("bridge", "no") == "no":
                lift = PROUD_M + BALLASTED_M * np.clip((away - 1.0) / RISE_M, 0, 1)
            path = on_ground(xy, ride_height(xy)) + np.column_stack([np.zeros((len(xy), 2)), lift])
            found += [Track(path, gauge, lift) for gauge in _gauges(tags)]
    return found


def _is_track(tags: Mapping[str, str]) -> bool:
    return (
        tags.get("railway") in RAILWAYS
        and tags.get("tunnel", "no") == "no"
        and tags.get("covered", "no") == "no"
        and tags.get("location") != "underground"
        and not tags.get("layer", "0").startswith("-")
        and not (tags.get("railway") == "subway" and "bridge" not in tags and "layer" not in tags)
    )


def _is_embedded(tags: Mapping[str, str]) -> bool:
    if (
        tags.get("embedded")
        or tags.get("railway:embedded")
        or tags.get("tram:segregation:physical")
    ):
        said = tags.get("embedded") or tags.get("railway:embedded")
        if said in ("no", "yes"):
            return said == "yes"
    if tags.get("surface") in ("ballast", "gravel", "sleepers") or tags.get("ballastless") == "no":
        return False
    return tags["railway"] == "tram" or "surface" in tags


def _gauges(tags: Mapping[str, str]) -> list[float]:
    """Return the gauges in metres; dual-gauge tracks have two."""
    said = map(whole_number, tags.get("gauge", "").split(";"))
    found = [g / 1000 for g in said if g is not None and 300 <= g <= 3000]
    return found[:2] or [GAUGE_M]
