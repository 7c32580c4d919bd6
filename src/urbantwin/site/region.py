"""Region of interest: a GeoJSON polygon in WGS84, transformed to the site frame."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import shapely
import shapely.geometry
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame, wrapped
from urbantwin.strict_json import NotJsonError, parse_json

__all__ = ["FARTHEST_M", "circle", "polygon_from_geojson", "polygon_in_site", "read_geojson"]

#: Largest distance of a region's border from the anchor, metres: beyond, single-precision rays lose
#: millimetres and the plane departs from the ellipsoid.
FARTHEST_M = 2000.0
#: Smallest area of a region with a junction, square metres.
SMALLEST_M2 = 1000.0
#: Largest distance of the anchor from a polygon, metres.
FARTHEST_ANCHOR_M = 200.0

#: Largest file, bytes; it takes ten times as much memory.
_MOST_BYTES = 400_000_000

_EXPECTED = "a GeoJSON Polygon in longitude, latitude (WGS84)"


def circle(radius_m: float) -> shapely.Polygon:
    """Return a circle about the anchor, site frame, as a polygon with 64 sides."""
    return shapely.Point(0.0, 0.0).buffer(radius_m, quad_segs=16)


def read_geojson(path: Path) -> Mapping[str, Any]:
    """Read a GeoJSON file's outermost object.

    Raises:
        InputError: the file is missing, is not JSON, holds something other than an object, or is
            too large.
    """
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise InputError("is larger than 400 MB", file=path, expected="GeoJSON cut to the site")
        value = parse_json(path.read_bytes())
    except FileNotFoundError:
        raise InputError("not found", file=path, expected=_EXPECTED) from None
    except IsADirectoryError:
        raise InputError("is a folder", file=path, expected=_EXPECTED) from None
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", file=path) from None
    except NotJsonError as error:
        problem = f"is not JSON ({error.problem})"
        raise InputError(problem, file=path, place=error.place, expected=_EXPECTED) from None
    if not isinstance(value, dict):
        raise InputError("is not a JSON object", file=path, expected=_EXPECTED)
    return value


def polygon_from_geojson(
    value: Mapping[str, Any], *, file: Path, place: str | None = None
) -> shapely.Polygon:
    """Return the only polygon of a GeoJSON geometry, Feature or FeatureCollection.

    Args:
        value: the GeoJSON object; longitude first (RFC 7946).
        file: file of the polygon, for error messages.
        place: place in the file.

    Returns:
        The polygon in longitude, latitude (degrees, WGS84), without holes.

    Raises:
        InputError: not exactly one polygon, or it crosses itself or has a hole.
    """

    def error(problem: str, expected: str | None = _EXPECTED) -> InputError:
        return InputError(problem, file=file, place=place, expected=expected)

    crs = str(value.get("crs") or "CRS84")
    if "CRS84" not in crs and "4326" not in crs:
        raise error(f"is in another CRS ({crs[:80]})")
    geometries = [item for item in _geometries(value) if isinstance(item, Mapping)]
    polygons = [item for item in geometries if item.get("type") in ("Polygon", "MultiPolygon")]
    if not polygons:
        kinds = sorted({str(item.get("type")) for item in geometries})
        raise error(f"holds no Polygon but {', '.join(kinds) or 'nothing'}")
    parts: list[Any] = []
    for item in polygons:
        rings = item.get("coordinates")
        rings = [rings] if item["type"] == "Polygon" else rings
        parts += rings if isinstance(rings, list) else [None]
    if len(parts) != 1:
        raise error(f"holds {len(parts)} polygons", "one polygon")
    if not isinstance(parts[0], list) or not parts[0]:
        raise error("has a Polygon without rings of coordinates")
    if len(parts[0]) > 1:
        raise error("has a hole", "a polygon without holes")
    try:
        ring = np.array([point[:2] for point in parts[0][0]], dtype=np.float64).reshape(-1, 2)
    except (TypeError, ValueError, KeyError):
        raise error("has a point that is not two numbers") from None
    return shapely.Polygon(_checked_ring(ring, error))


def polygon_in_site(
    polygon: shapely.Polygon, frame: SiteFrame, *, file: Path, place: str | None = None
) -> shapely.Polygon:
    """Return a polygon of longitude and latitude in the site frame, counter-clockwise.

    Raises:
        InputError: it is too small, reaches too far, or is far from the anchor.
    """
    lonlat = shapely.get_coordinates(polygon)
    region = shapely.Polygon(frame.site_from_lonlat(_near(lonlat, frame)))
    problem = _misplaced(region)
    expected = f"a polygon around the anchor, within {FARTHEST_M:g} m of it"
    if problem:
        if np.abs(lonlat[:, ::-1] - [frame.longitude, frame.latitude]).max() < 0.1:
            problem += ", and latitude comes first in it"
            expected = _EXPECTED
        raise InputError(problem, file=file, place=place, expected=expected)
    if region.area < SMALLEST_M2:
        raise InputError(
            f"covers {region.area:.1f} m²",
            file=file,
            place=place,
            expected=f"at least {SMALLEST_M2:g} m²",
        )
    return shapely.geometry.polygon.orient(region)


def _checked_ring(ring: NDArray[np.float64], error: Any) -> NDArray[np.float64]:  # noqa: ANN401
    if not np.isfinite(ring).all():
        raise error("has a coordinate that is not a finite number")
    beyond = (np.abs(ring) > [180.0, 90.0]).any(axis=1)
    if beyond.any():
        bad = ring[np.argmax(beyond)]
        raise error(f"has a point at {bad[0]:g}, {bad[1]:g}, which is not in degrees")
    if len(np.unique(ring, axis=0)) < 3:
        raise error(f"has {len(np.unique(ring, axis=0))} different points", "at least three")
    if shapely.MultiPoint(ring).convex_hull.area < 1e-15:  # square degrees: a square millimetre
        raise error("has all its points on a line", "a polygon with an area")
    # GeoJSON rings are closed; open ones are accepted as well.
    shape = shapely.Polygon(ring)
    if not shape.is_valid:
        reason, _, where = shapely.is_valid_reason(shape).partition("[")
        where = ", ".join(f"{float(number):.7g}" for number in where.rstrip("]").split())
        known = {"Self-intersection": "crosses itself", "Ring Self-intersection": "touches itself"}
        at = f" at {where} (longitude, latitude)" if where else ""
        raise error(known.get(reason, f"is not valid ({reason})") + at, "a simple polygon")
    return ring


def _geometries(value: Mapping[str, Any]) -> Iterator[Any]:
    """Yield the geometries of a geometry, a Feature or a FeatureCollection."""
    if value.get("type") == "FeatureCollection":
        features = value.get("features")
        for feature in features if isinstance(features, list) else []:
            if isinstance(feature, Mapping):
                yield feature.get("geometry")
    elif value.get("type") == "Feature":
        yield value.get("geometry")
    else:
        yield value


def _near(lonlat: NDArray[np.float64], frame: SiteFrame) -> NDArray[np.float64]:
    """Return points limited to the distance at which the plane's formulas hold (about 300 km).

    A polygon on another continent keeps its direction and stays far away, which suffices.
    """
    east = wrapped(lonlat[:, 0] - frame.longitude, 360.0)
    offset = np.column_stack([east, lonlat[:, 1] - frame.latitude])
    return np.array([frame.longitude, frame.latitude]) + np.clip(offset, -3.0, 3.0)


def _misplaced(polygon: shapely.Polygon) -> str | None:
    anchor = shapely.Point(0.0, 0.0)
    away = shapely.distance(polygon, anchor)
    farthest = np.linalg.norm(shapely.get_coordinates(polygon), axis=1).max()
    if away > FARTHEST_ANCHOR_M:
        far = "hundreds of km" if away > 1e5 else f"{away:.0f} m"
        return f"is {far} away from the anchor"
    if farthest > FARTHEST_M:
        return f"reaches {farthest:.0f} m from the anchor"
    return None
