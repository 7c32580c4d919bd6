"""Conservative test of which tiles intersect the region of interest."""

from __future__ import annotations

import math

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import CRS, Transformer
from pyproj.exceptions import CRSError, ProjError

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.io.tiles3d.tile import Volume
from urbantwin.site.geometry import GeometrySource

__all__ = ["Interest", "is_on_earth", "site_from_tileset"]

#: Margin of the test, metres, above the 0.08 m by which plane and curved Earth deviate at 1 km.
_SLACK_M = 5.0
#: Maximum height above or below the anchor's tangent plane within a site, metres.
_TALLEST_M = 20_000.0
#: Distance from the region beyond which triangles are dropped, metres.
_FAR_M = 500.0


class Interest:
    """The region of interest, and the transform of a tileset's frame to it.

    Args:
        region: site frame, metres.
        frame: the site frame.
        to_site: (4, 4) from the tileset's frame to the site's, or ``None`` if unknown: every box
            and sphere then intersects the region.
        margin_m: margin around the region, metres.
    """

    def __init__(
        self,
        region: shapely.Polygon,
        frame: SiteFrame,
        to_site: NDArray[np.float64] | None,
        margin_m: float = 0.0,
    ) -> None:
        self._to_site = to_site
        area = region.buffer(_SLACK_M + margin_m)
        shapely.prepare(area)
        self._area = area
        self._bounds = area.bounds
        ring = shapely.get_coordinates(area.exterior.segmentize(100.0))
        self._lonlat = shapely.Polygon(np.radians(frame.lonlat_from_site(ring)))
        shapely.prepare(self._lonlat)

    def meets(self, volume: Volume) -> bool:
        """Return whether a volume may intersect the region."""
        if volume.kind in ("cell", "unknown"):
            return True
        if volume.kind == "region":
            west, south, east, north = volume.values[:4]
            return any(
                self._lonlat.intersects(shapely.box(west + turn, south, east + turn, north))
                for turn in (0.0, -2 * math.pi, 2 * math.pi)
            )
        if self._to_site is None:
            return True
        x0, y0, x1, y1 = self._bounds
        corners = self.in_site(volume.corners())
        if not np.isfinite(corners).all():  # numeric overflow
            return True
        low, high = corners.min(axis=0), corners.max(axis=0)
        beside = low[0] > x1 or low[1] > y1 or high[0] < x0 or high[1] < y0
        if beside or low[2] > _TALLEST_M or high[2] < -_TALLEST_M:
            return False
        hull = shapely.convex_hull(shapely.multipoints(corners[:, :2]))
        return bool(self._area.intersects(hull))

    def in_site(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points (N, 3) of the tileset's frame in the site frame (tangent plane)."""
        assert self._to_site is not None
        return np.asarray(points @ self._to_site[:3, :3].T + self._to_site[:3, 3])

    def near(
        self, vertices: NDArray[np.float64], faces: NDArray[np.int32]
    ) -> NDArray[np.bool_] | None:
        """Return the mask of triangles (F,) near the region; ``None`` for all of them."""
        if self._to_site is None:
            return None
        low = np.array([*self._bounds[:2], -_TALLEST_M]) - _FAR_M
        high = np.array([*self._bounds[2:], _TALLEST_M]) + _FAR_M
        points = self.in_site(vertices)
        if (points >= low).all() and (points <= high).all():
            return None
        corners = points[faces]
        meet = (corners.max(axis=1) >= low) & (corners.min(axis=1) <= high)
        return np.asarray(meet.all(axis=1))

    def near_points(self, points: NDArray[np.float64]) -> NDArray[np.bool_] | None:
        """Return the mask of points (N,) near the region; ``None`` for all of them."""
        if self._to_site is None:
            return None
        low = np.array(self._bounds[:2]) - _FAR_M
        high = np.array(self._bounds[2:]) + _FAR_M
        xy = self.in_site(points)[:, :2]
        return np.asarray(((xy >= low) & (xy <= high)).all(axis=1))


def is_on_earth(volume: Volume) -> bool:
    """Return whether a root's volume is in an Earth-centred frame, not in a local one."""
    if volume.kind in ("region", "cell", "unknown"):
        return True
    distance = float(np.linalg.norm(volume.values[:3]))
    if volume.kind == "sphere":
        radius = float(volume.values[3])
    else:
        radius = float(np.linalg.norm(volume.values[3:].reshape(3, 3), axis=1).sum())
    return abs(distance - 6.367e6) <= radius + 40_000.0 and distance + radius > 6.2e6


def site_from_tileset(
    source: GeometrySource, frame: SiteFrame, *, on_earth: bool
) -> NDArray[np.float64] | None:
    """Return the approximate (4, 4) transform from a tileset's frame to the site's.

    ``None`` if it is only known after control points or registration.

    Raises:
        InputError: the source's CRS is unknown.
    """
    spec = source.spec
    if on_earth:
        return _site_from_ecef(frame)
    if spec.register_to is not None or spec.up == "y" or spec.unit not in ("auto", "m", 1.0):
        return None
    result = np.eye(4)
    if spec.origin is not None:
        place = frame.site_from_lonlat([spec.origin.longitude, spec.origin.latitude])[0]
        turn = -math.radians(spec.origin.heading_deg)
        result[:2, :2] = [[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]]
        result[:2, 3] = place
        return result
    if spec.crs is not None and spec.control_points is None and spec.similarity is None:
        return _site_from_crs(source, frame)
    return None


def _site_from_ecef(frame: SiteFrame) -> NDArray[np.float64]:
    """Return the transform from EPSG:4978 to east, north, up at the anchor."""
    to_ecef = Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
    anchor = np.array(to_ecef.transform(frame.longitude, frame.latitude, 0.0))
    lat, lon = math.radians(frame.latitude), math.radians(frame.longitude)
    result = np.eye(4)
    result[0, :3] = [-math.sin(lon), math.cos(lon), 0.0]
    result[1, :3] = [
        -math.sin(lat) * math.cos(lon),
        -math.sin(lat) * math.sin(lon),
        math.cos(lat),
    ]
    result[2, :3] = [math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)]
    result[:3, 3] = -result[:3, :3] @ anchor
    return result


def _site_from_crs(source: GeometrySource, frame: SiteFrame) -> NDArray[np.float64] | None:
    """Return the affine transform from a projected CRS at the anchor to the site's plane."""
    try:
        crs = CRS.from_user_input(source.spec.crs)
        if not crs.is_projected and not (crs.is_compound and crs.sub_crs_list[0].is_projected):
            return None
        to_crs = Transformer.from_crs(frame.proj_with_datum, crs, always_xy=True)
        reach = 1000.0
        x, y = to_crs.transform([0.0, reach, 0.0], [0.0, 0.0, reach])
    except (CRSError, ProjError):
        raise InputError(
            f"{source.spec.crs!r} is not a known coordinate reference system",
            file=source.document.file,
            place=source.place("crs"),
            expected="a code such as EPSG:7415",
        ) from None
    forward = np.array([[x[1] - x[0], x[2] - x[0]], [y[1] - y[0], y[2] - y[0]]]) / reach
    if not np.isfinite(forward).all() or abs(np.linalg.det(forward)) < 1e-9:
        return None
    result = np.eye(4)
    result[:2, :2] = np.linalg.inv(forward)
    result[:2, 3] = -result[:2, :2] @ [x[0], y[0]]
    return result
