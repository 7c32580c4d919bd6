"""The region in the coordinates of another system."""

from __future__ import annotations

import numpy as np
import shapely
from pyproj import CRS, Transformer
from pyproj.exceptions import ProjError

from urbantwin.geometry import SiteFrame

__all__ = ["MARGIN_M", "bounds_in"]

#: Kept around the region, metres.
MARGIN_M = 25.0


def bounds_in(
    crs: CRS, frame: SiteFrame, region: shapely.Polygon
) -> tuple[float, float, float, float] | None:
    """Return west, south, east, north of the region in a system, ``None`` for geocentric ones.

    Args:
        crs: the system, x east and y north (longitude first where it is geographic).
        frame: the site frame.
        region: the region, site frame.
    """
    if crs.is_geocentric:
        return None
    around = region.buffer(MARGIN_M).envelope.segmentize(50.0)
    lonlat = frame.lonlat_from_site(shapely.get_coordinates(around))
    try:
        transform = Transformer.from_crs("EPSG:4326", crs.to_2d(), always_xy=True)
        x, y = transform.transform(lonlat[:, 0], lonlat[:, 1])
    except ProjError:
        return None
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        return None
    return float(min(x)), float(min(y)), float(max(x)), float(max(y))
