"""A sketch's file: GeoJSON as editors write it, with every feature in the site frame."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import CRS, Transformer
from pyproj.exceptions import CRSError

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.site.region import FARTHEST_M, read_geojson
from urbantwin.site.sketch.kinds import KINDS, POINTS_LINES_AREAS, THINGS, Drawn
from urbantwin.site.yaml_document import Document, nearest

__all__ = ["Feature", "read_drawing"]

#: Properties that editors add for their own use.
EDITORS = re.compile(r"(stroke|fill|marker)([-_].*)?|_.*|ogc_fid|fid|id|OBJECTID|note|source|\$.*")
#: What is written of metres of the site frame, and of degrees.
SITE, DEGREES = "site", ("CRS84", "4326")
#: Tags that a feature of any kind may have besides: ``osm:parking:right``.
AS_TAG = "osm:"


@dataclass(frozen=True, eq=False)
class Feature:
    """Something drawn.

    Attributes:
        number: which of the file's features it is, from 0.
        drawn: its properties; ``None`` for tags of a map.
        further: tags that it has besides.
        geometry: a Point, LineString or Polygon, site frame.
        place: where it stands in the file, for error messages.
    """

    number: int
    drawn: Drawn | None
    further: Mapping[str, str]
    geometry: shapely.Geometry
    place: str

    @property
    def tags(self) -> dict[str, str]:
        """The tags that it has on a map."""
        return {**(self.drawn.tags() if self.drawn is not None else {}), **self.further}


def read_drawing(path: Path, frame: SiteFrame) -> list[Feature]:
    """Read a sketch.

    Args:
        path: GeoJSON: a FeatureCollection whose features have the property ``kind``. Its ``crs`` is
            ``site`` (metres in the site frame), one that editors write, or missing: degrees.
        frame: the site frame.

    Raises:
        InputError: something in it is wrong; the first such feature is named.
    """
    value = read_geojson(path)
    features = value.get("features")
    if value.get("type") != "FeatureCollection" or not isinstance(features, list):
        raise InputError(
            "is no FeatureCollection", file=path, expected="features, drawn as GeoJSON"
        )
    to_site = _to_site(path, value.get("crs"), frame)
    found = [
        feature
        for number, one in enumerate(features)
        for feature in _features(path, number, one, to_site)
    ]
    if not found:
        raise InputError("holds nothing drawn", file=path, expected="streets (kind: street)")
    return found


class _ToSite:
    """Coordinates of the file to the site frame."""

    def __init__(self, frame: SiteFrame, crs: CRS | None, *, metres: bool) -> None:
        self._frame, self.metres, self.degrees = frame, metres, crs is None and not metres
        self._change = (
            None if crs is None else Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
        )

    def __call__(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (N, 2) site metres."""
        if self.metres:
            return points
        if self._change is not None:
            points = np.column_stack(self._change.transform(points[:, 0], points[:, 1]))
        return self._frame.site_from_lonlat(points)


def _to_site(path: Path, crs: Any, frame: SiteFrame) -> _ToSite:  # noqa: ANN401
    if isinstance(crs, Mapping):
        properties = crs.get("properties")
        crs = properties.get("name") if isinstance(properties, Mapping) else None
    if crs is None or any(name in str(crs) for name in DEGREES):
        return _ToSite(frame, None, metres=False)
    if crs == SITE:
        return _ToSite(frame, None, metres=True)
    try:
        return _ToSite(frame, CRS.from_user_input(crs), metres=False)
    except (CRSError, TypeError):
        problem = f"is {str(crs)[:80]!r}, which nobody knows"
        raise InputError(
            problem, file=path, place="crs", expected="site, or a CRS such as EPSG:25832"
        ) from None


def _features(path: Path, number: int, value: Any, to_site: _ToSite) -> Iterator[Feature]:  # noqa: ANN401
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
    for shape in _shapes(path, named, geometry, types, to_site):
        yield Feature(number, drawn, further, shape, named)


def _shapes(
    path: Path,
    place: str,
    geometry: Mapping[str, Any],
    types: tuple[str, ...],
    to_site: _ToSite,
) -> Iterator[shapely.Geometry]:
    """Yield the parts of a geometry in the site frame."""

    def error(problem: str, expected: str) -> InputError:
        return InputError(problem, file=path, place=place, expected=expected)

    kind = str(geometry.get("type"))
    parts = geometry.get("coordinates")
    if kind.startswith("Multi"):
        kind = kind.removeprefix("Multi")
    else:
        parts = [parts]
    if kind not in types:
        raise error(f"is drawn as {kind}", " or ".join(types))
    if not isinstance(parts, list) or not parts:
        raise error("has no coordinates", f"a {kind}")
    for part in parts:
        rings = part if kind == "Polygon" else [[part] if kind == "Point" else part]
        try:
            points = np.array([point[:2] for point in rings[0]], dtype=np.float64).reshape(-1, 2)
        except (TypeError, ValueError, IndexError, KeyError):
            raise error("has a point that is not two numbers", f"a {kind}") from None
        if not len(points):
            raise error("has no coordinates", f"a {kind}")
        if to_site.degrees and (np.abs(points) > [180.0, 90.0]).any():
            bad = points[(np.abs(points) > [180.0, 90.0]).any(axis=1)][0]
            raise error(
                f"has a point at {bad[0]:g}, {bad[1]:g}, which is not in degrees",
                'longitude, latitude; or "crs": "site" for metres in the site frame',
            )
        xy = to_site(points)
        if not np.isfinite(xy).all() or np.abs(xy).max() > FARTHEST_M:
            raise error("is not near the anchor", f"at most {FARTHEST_M:g} m from it")
        yield _shape(kind, xy, error)


def _shape(kind: str, xy: NDArray[np.float64], error: Any) -> shapely.Geometry:  # noqa: ANN401
    if kind == "Point":
        return shapely.Point(xy[0])
    kept = np.concatenate([[True], np.linalg.norm(np.diff(xy, axis=0), axis=1) > 0.01])
    xy = xy[kept]
    if len(xy) < (2 if kind == "LineString" else 3):
        raise error(f"has {len(xy)} different points", "two at least; three of an area")
    if kind == "LineString":
        return shapely.LineString(xy)
    area = shapely.Polygon(xy)
    if not area.is_valid or area.area < 0.01:
        raise error("crosses itself or has no area", "an outline")
    return area
