"""Additional building footprints, which complete heights and buildings of the map.

Footprints with heights (Overture, a city's register) are a GeoJSON file. A mapped building only
gets a height if the map has none; buildings missing in the map are added.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import shapely
import shapely.geometry

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.site.extract import Extract, OsmFeature, Relation, Way
from urbantwin.site.region import read_geojson

__all__ = ["Footprint", "read_buildings", "with_buildings"]

_EXPECTED = "GeoJSON: polygons in longitude, latitude (WGS84), with the tags of buildings"
#: Tags of a footprint that are used, as in OpenStreetMap; other properties are ignored.
TAGS = (
    "building", "height", "min_height", "building:levels", "building:min_level", "roof:shape",
    "roof:height", "roof:direction", "roof:orientation", "building:material", "roof:material",
    "building:colour", "roof:colour",
)  # fmt: skip
#: Tags with the height of a mapped building.
_HEIGHTS = ("height", "building:levels")
#: Overlap, as a fraction of the larger outline, from which a footprint is a mapped building; and
#: overlap with all buildings below which it is a new one. Anything in between is ambiguous.
SAME, APART = 0.6, 0.1
#: Most footprints of a file, and smallest area of a footprint, square metres.
MOST, SMALLEST_M2 = 500_000, 2.0


@dataclass(frozen=True)
class Footprint:
    """A building of the file.

    Attributes:
        outline: outline, longitude and latitude, degrees.
        tags: its `TAGS`, in OpenStreetMap's notation.
    """

    outline: shapely.Polygon
    tags: dict[str, str]


def read_buildings(path: Path) -> list[Footprint]:
    """Read footprints with heights.

    Raises:
        InputError: the file is missing, not GeoJSON with polygons in degrees, or has too many.
    """
    value = read_geojson(path)
    crs = str(value.get("crs") or "CRS84")
    if "CRS84" not in crs and "4326" not in crs:
        raise InputError(f"is in another CRS ({crs[:80]})", file=path, expected=_EXPECTED)
    features = value.get("features")
    if value.get("type") != "FeatureCollection" or not isinstance(features, list):
        raise InputError("is not a FeatureCollection", file=path, expected=_EXPECTED)
    if len(features) > MOST:
        raise InputError(
            f"holds {len(features):,} buildings", file=path, expected=f"at most {MOST:,}"
        )
    found: list[Footprint] = []
    for number, feature in enumerate(features):
        place = f"features[{number}]"
        if not isinstance(feature, Mapping):
            raise InputError("is not a Feature", file=path, place=place, expected=_EXPECTED)
        properties = feature.get("properties")
        tags = _tags(properties if isinstance(properties, Mapping) else {}, path, place)
        found += [Footprint(one, tags) for one in _outlines(feature.get("geometry"), path, place)]
    return found


def with_buildings(
    extract: Extract, footprints: list[Footprint], frame: SiteFrame, area: shapely.Polygon
) -> tuple[Extract, dict[str, int]]:
    """Return a map completed with heights and buildings of other footprints.

    Args:
        extract: the map.
        footprints: footprints of another source.
        frame: the site frame.
        area: area of the used footprints, site frame, metres.

    Returns:
        The map, and counts: ``footprints`` that intersect the area, ``heights`` given to mapped
        buildings, ``added`` buildings, and ``unclear`` ones, which overlap partly with mapped
        buildings and are omitted.
    """
    mapped = [
        one
        for one in extract.features(frame, area)
        if isinstance(one.geometry, shapely.Polygon | shapely.MultiPolygon)
        and {"building", "building:part"} & one.tags.keys()
        and "no" not in (one.tags.get("building"), one.tags.get("building:part"))
    ]
    tree = shapely.STRtree([one.geometry for one in mapped])
    ways, relations = dict(extract.ways), dict(extract.relations)
    nodes = dict(extract.nodes)
    highest = extract.highest
    free = count(1 + max([0, *nodes, *ways, *relations, *highest]))
    counts = dict.fromkeys(("footprints", "heights", "added", "unclear"), 0)
    for one in footprints:
        outline = _in_site(one.outline, frame)
        if outline.is_empty or outline.area < SMALLEST_M2 or not outline.intersects(area):
            continue
        counts["footprints"] += 1
        near = [mapped[int(k)] for k in tree.query(outline, predicate="intersects")]
        same, share = _same(outline, near)
        if same is not None:
            counts["heights"] += _given_height(ways, relations, same, one.tags)
        elif share > APART:
            counts["unclear"] += 1
        else:
            counts["added"] += 1
            _add(one, nodes, ways, relations, free)
    return replace(extract, nodes=nodes, ways=ways, relations=relations), counts


def _same(outline: shapely.Polygon, near: list[OsmFeature]) -> tuple[OsmFeature | None, float]:
    """Return the mapped building that equals an outline, and the mapped fraction of the outline."""
    best, most, mapped = None, 0.0, 0.0
    for one in near:
        common = shapely.intersection(outline, one.geometry).area
        mapped += common / outline.area
        share = common / max(outline.area, one.geometry.area)
        if "building" in one.tags and share > max(most, SAME):
            best, most = one, share
    return best, mapped


def _given_height(
    ways: dict[int, Way],
    relations: dict[int, Relation],
    building: OsmFeature,
    tags: Mapping[str, str],
) -> int:
    """Add a missing height to a mapped building; return 1 if added, else 0."""
    held: dict[int, Way] | dict[int, Relation] = ways if building.kind == "way" else relations
    own = held[building.id].tags
    heights = {key: tags[key] for key in (*_HEIGHTS, "roof:height") if key in tags}
    if any(key in own for key in _HEIGHTS) or not any(key in heights for key in _HEIGHTS):
        return 0
    if building.kind == "way":
        ways[building.id] = replace(ways[building.id], tags=own | heights)
    else:
        relations[building.id] = replace(relations[building.id], tags=own | heights)
    return 1


def _add(
    one: Footprint,
    nodes: dict[int, tuple[float, float]],
    ways: dict[int, Way],
    relations: dict[int, Relation],
    free: Iterator[int],
) -> None:
    """Add a building that the map lacks."""
    tags = {"building": "yes"} | one.tags
    rings = []
    for ring in (one.outline.exterior, *one.outline.interiors):
        members = []
        for longitude, latitude in shapely.get_coordinates(ring)[:-1].tolist():
            members.append(next(free))
            nodes[members[-1]] = (longitude, latitude)
        identity = next(free)
        ways[identity] = Way(identity, (*members, members[0]), {})
        rings.append(identity)
    if len(rings) == 1:
        ways[rings[0]] = replace(ways[rings[0]], tags=tags)
        return
    roles = ["outer"] + ["inner"] * (len(rings) - 1)
    parts = tuple(("w", ring, role) for ring, role in zip(rings, roles, strict=True))
    identity = next(free)
    relations[identity] = Relation(identity, parts, {"type": "multipolygon"} | tags)


def _in_site(outline: shapely.Polygon, frame: SiteFrame) -> shapely.Polygon:
    """Return an outline in the site frame; empty if too far away for a plane."""
    west, south, east, north = outline.bounds
    if max(abs(west - frame.longitude), abs(east - frame.longitude)) > 1.0:
        return shapely.Polygon()
    if max(abs(south - frame.latitude), abs(north - frame.latitude)) > 1.0:
        return shapely.Polygon()
    placed = shapely.transform(outline, frame.site_from_lonlat)
    return placed if placed.is_valid else shapely.Polygon()


def _outlines(geometry: object, path: Path, place: str) -> Iterator[shapely.Polygon]:
    """Yield the valid polygons of a geometry; other types of geometry yield none.

    Raises:
        InputError: not a geometry, or not in degrees.
    """
    if not isinstance(geometry, Mapping) or geometry.get("type") not in ("Polygon", "MultiPolygon"):
        return
    try:
        shape = shapely.force_2d(shapely.geometry.shape(dict(geometry)))
    except Exception:
        raise InputError(
            "has coordinates that are none", file=path, place=place, expected=_EXPECTED
        ) from None
    points = shapely.get_coordinates(shape)
    if not len(points):
        return
    if not np.isfinite(points).all() or (np.abs(points) > [180.0, 90.0]).any():
        raise InputError(
            "has a point that is not in degrees", file=path, place=place, expected=_EXPECTED
        )
    if not shape.is_valid:
        shape = shapely.make_valid(shape, method="structure")
    for part in shapely.get_parts(shape):
        if isinstance(part, shapely.Polygon) and not part.is_empty:
            yield part


def _tags(properties: Mapping[Any, Any], path: Path, place: str) -> dict[str, str]:
    """Return the used tags of a footprint's properties.

    Raises:
        InputError: a height is not plausible.
    """
    tags = {}
    for key in TAGS:
        value = properties.get(key)
        if isinstance(value, bool) or not isinstance(value, str | int | float) or value == "":
            continue
        if key in ("height", "min_height", "roof:height", "building:levels"):
            number = _number(value)
            if number is None or not 0.0 <= number <= 1000.0:
                raise InputError(
                    f"is {value!r:.40}",
                    file=path,
                    place=f"{place}.properties.{key}",
                    expected="metres (of levels: how many), 0 to 1000",
                )
            value = f"{number:g}"
        tags[key] = str(value)[:255]
    if tags.get("building") == "no":
        tags["building"] = "yes"
    return tags


def _number(value: str | float) -> float | None:
    if isinstance(value, str):
        told = re.fullmatch(r"\s*([0-9]{1,6}(\.[0-9]{1,9})?)\s*m?\s*", value, re.ASCII)
        return float(told[1]) if told else None
    return float(value) if math.isfinite(value) else None
