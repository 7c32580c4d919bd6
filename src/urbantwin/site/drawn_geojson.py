"""Drawn GeoJSON: coordinates transformed to the site frame, properties of editors."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import CRS, Transformer
from pyproj.exceptions import CRSError

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.site.region import FARTHEST_M

__all__ = ["EDITORS", "ToSite", "shapes_in_site", "to_site"]

#: Properties that editors add for their own use.
EDITORS = re.compile(r"(stroke|fill|marker)([-_].*)?|_.*|ogc_fid|fid|id|OBJECTID|note|source|\$.*")
#: Values of ``crs`` for metres of the site frame, and for degrees.
SITE, DEGREES = "site", ("CRS84", "4326")


class ToSite:
    """Transformation from the file's coordinates to the site frame."""

    def __init__(self, frame: SiteFrame, crs: CRS | None, *, metres: bool) -> None:
        self._frame, self.metres, self.degrees = frame, metres, crs is None and not metres
        self._change = (
            None if crs is None else Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
        )

    def __call__(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return site positions (N, 2), metres."""
        if self.metres:
            return points
        if self._change is not None:
            points = np.column_stack(self._change.transform(points[:, 0], points[:, 1]))
        return self._frame.site_from_lonlat(points)


def to_site(path: Path, crs: Any, frame: SiteFrame) -> ToSite:  # noqa: ANN401
    """Return the transformation from a file's coordinates to the site frame.

    Args:
        path: the file, for error messages.
        crs: its ``crs``: ``site``, a CRS written by editors, or ``None`` for degrees.
        frame: the site frame.

    Raises:
        InputError: the CRS is unknown.
    """
    if isinstance(crs, Mapping):
        properties = crs.get("properties")
        crs = properties.get("name") if isinstance(properties, Mapping) else None
    if crs is None or any(name in str(crs) for name in DEGREES):
        return ToSite(frame, None, metres=False)
    if crs == SITE:
        return ToSite(frame, None, metres=True)
    try:
        return ToSite(frame, CRS.from_user_input(crs), metres=False)
    except (CRSError, TypeError):
        problem = f"is {str(crs)[:80]!r}, which nobody knows"
        raise InputError(
            problem, file=path, place="crs", expected="site, or a CRS such as EPSG:25832"
        ) from None


def shapes_in_site(
    path: Path,
    place: str,
    geometry: Mapping[str, Any],
    types: tuple[str, ...],
    to_site: ToSite,
) -> Iterator[shapely.Geometry]:
    """Yield the parts of a geometry in the site frame.

    Args:
        path: the file, for error messages.
        place: place in the file.
        geometry: GeoJSON geometry.
        types: allowed types: ``Point``, ``LineString``, ``Polygon``.
        to_site: transformation of the file's coordinates.

    Raises:
        InputError: another type, no coordinates, or far from the anchor.
    """

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
        if not _is_near(xy):
            problem, expected = "is not near the anchor", f"at most {FARTHEST_M:g} m from it"
            if to_site.degrees and _is_near(to_site(points[:, ::-1])):
                problem += ", and latitude comes first in it"
                expected = "longitude, latitude"
            raise error(problem, expected)
        yield _shape(kind, xy, error)


def _is_near(xy: NDArray[np.float64]) -> bool:
    return bool(np.isfinite(xy).all() and np.abs(xy).max() <= FARTHEST_M)


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
