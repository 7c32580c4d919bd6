"""Sketch file: GeoJSON of editors, with every feature in the site frame."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import shapely

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.site.drawn_geojson import EDITORS, ToSite, shapes_in_site, to_site
from urbantwin.site.region import read_geojson
from urbantwin.site.sketch.kinds import KINDS, POINTS_LINES_AREAS, THINGS, Drawn
from urbantwin.site.yaml_document import Document, nearest

__all__ = ["Feature", "read_drawing"]

#: Prefix of additional tags of a feature of any kind: ``osm:parking:right``.
AS_TAG = "osm:"


@dataclass(frozen=True, eq=False)
class Feature:
    """A drawn feature.

    Attributes:
        number: index of the feature in the file, from 0.
        drawn: its properties; ``None`` for plain map tags.
        further: additional tags.
        geometry: a Point, LineString or Polygon, site frame.
        place: place in the file, for error messages.
    """

    number: int
    drawn: Drawn | None
    further: Mapping[str, str]
    geometry: shapely.Geometry
    place: str

    @property
    def tags(self) -> dict[str, str]:
        """Its map tags."""
        return {**(self.drawn.tags() if self.drawn is not None else {}), **self.further}


def read_drawing(path: Path, frame: SiteFrame) -> list[Feature]:
    """Read a sketch.

    Args:
        path: GeoJSON: a FeatureCollection whose features have the property ``kind``. Its ``crs`` is
            ``site`` (metres in the site frame), a CRS written by editors, or missing (degrees).
        frame: the site frame.

    Raises:
        InputError: a feature is wrong; names the first.
    """
    value = read_geojson(path)
    features = value.get("features")
    if value.get("type") != "FeatureCollection" or not isinstance(features, list):
        raise InputError(
            "is no FeatureCollection", file=path, expected="features, drawn as GeoJSON"
        )
    to_metres = to_site(path, value.get("crs"), frame)
    found = [
        feature
        for number, one in enumerate(features)
        for feature in _features(path, number, one, to_metres)
    ]
    if not found:
        raise InputError("holds nothing drawn", file=path, expected="streets (kind: street)")
    return found


def _features(path: Path, number: int, value: Any, to_metres: ToSite) -> Iterator[Feature]:  # noqa: ANN401
    place = f"features[{number}]"
    geometry = value.get("geometry") if isinstance(value, Mapping) else None
    properties = value.get("properties") if isinstance(value, Mapping) else None
    if not isinstance(geometry, Mapping) or not isinstance(properties, Mapping):
        raise InputError("is no feature", file=path, place=place, expected="geometry, properties")
    given = {
        str(key): one
        for key, one in properties.items()
        if one not in (None, "") and not EDITORS.fullmatch(str(key))
    }
    document = Document(path, given, None, (place,))
    kind = str(given.get("kind", ""))
    if kind not in KINDS:
        problem = f"is {kind!r}" if kind else "is missing"
        raise document.error(problem, ("kind",), nearest(kind, list(KINDS)))
    further = {
        key.removeprefix(AS_TAG): str(one) for key, one in given.items() if key.startswith(AS_TAG)
    }
    model = KINDS[kind]
    if model is None:
        drawn: Drawn | None = None
        types: tuple[str, ...] = POINTS_LINES_AREAS
        further |= {key: str(one) for key, one in given.items() if key != "kind"}
    else:
        own = {key: one for key, one in given.items() if not key.startswith(AS_TAG)}
        drawn = Document(path, own, None, (place,)).validated(model)
        types = THINGS[kind][0] if kind in THINGS else model.drawn_as()
    named = f"{place} ({kind})"
    for shape in shapes_in_site(path, named, geometry, types, to_metres):
        yield Feature(number, drawn, further, shape, named)
