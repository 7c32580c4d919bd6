"""The site frame: right-handed east-north-up metres at the site's anchor."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pyproj import Transformer

__all__ = ["SiteFrame"]


@dataclass(frozen=True)
class SiteFrame:
    """A transverse Mercator plane centred on the anchor: x east, y north, scale 1 at the anchor.

    Within 1 km of the anchor the plane's scale error is less than 2e-8 (Snyder 1987, eq. 8-7), so
    its metres equal those on the ground.

    Args:
        latitude: the anchor's latitude, degrees, WGS84.
        longitude: the anchor's longitude, degrees, WGS84.
    """

    latitude: float
    longitude: float

    @property
    def proj(self) -> str:
        """The plane as a PROJ string: written to every file that names a CRS."""
        return (
            f"+proj=tmerc +lat_0={self.latitude!r} +lon_0={self.longitude!r} "
            "+k=1 +x_0=0 +y_0=0 +ellps=WGS84 +units=m +no_defs"
        )

    @property
    def proj_with_datum(self) -> str:
        """The plane with its datum, required for transformations from other datums.

        `proj` only has an ellipsoid, which PROJ treats as any datum: a transform from another datum
        (Amersfoort, DHDN, OSGB36) would omit its shift, 100 m and more.
        """
        return self.proj.replace("+ellps=WGS84", "+datum=WGS84")

    @cached_property
    def _forward(self) -> Transformer:
        return Transformer.from_crs("EPSG:4326", self.proj_with_datum, always_xy=True)

    def site_from_lonlat(self, lonlat: ArrayLike) -> NDArray[np.float64]:
        """Return (N, 2) site metres of (N, 2) longitude/latitude degrees."""
        points = np.asarray(lonlat, dtype=np.float64).reshape(-1, 2)
        return np.column_stack(self._forward.transform(points[:, 0], points[:, 1]))

    def lonlat_from_site(self, xy: ArrayLike) -> NDArray[np.float64]:
        """Return (N, 2) longitude/latitude degrees of (N, 2) site metres."""
        points = np.asarray(xy, dtype=np.float64).reshape(-1, 2)
        return np.column_stack(
            self._forward.transform(points[:, 0], points[:, 1], direction="INVERSE")
        )
