"""Whether an extract has roads where they are wanted."""

from __future__ import annotations

import numpy as np
import shapely
from pyproj import Geod

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.site.extract import Extract

__all__ = ["check_roads"]


def check_roads(extract: Extract, frame: SiteFrame, region: shapely.Polygon, named: str) -> None:
    """Check that an extract has roads in a region.

    Args:
        extract: the extract.
        frame: the site frame.
        region: the region, site frame.
        named: what errors call the region.

    Raises:
        InputError: it has no roads at all, or none in the region; it says how far away they are.
    """
    highways = extract.highways()
    expected = f"an extract around {frame.latitude:.6f}, {frame.longitude:.6f}"
    if not highways and not extract.is_whole:
        raise InputError(f"has no road near {named}", file=extract.path, expected=expected)
    if not highways:
        raise InputError("holds no roads", file=extract.path, expected="ways with a highway tag")
    lonlat = [np.array([extract.nodes[n] for n in way.nodes if n in extract.nodes])
              for way in highways]  # fmt: skip
    lonlat = [points for points in lonlat if len(points) >= 2]
    anchor = np.array([frame.longitude, frame.latitude])
    # One degree: where the plane's formulas surely hold.
    near = [points for points in lonlat if np.abs(points - anchor).max() < 1.0]
    lines = [shapely.LineString(frame.site_from_lonlat(points)) for points in near]
    if lines:
        nearest_m = float(shapely.distance(np.array(lines), region).min())
    elif lonlat:
        nodes = np.vstack(lonlat)
        away_m = Geod(ellps="WGS84").inv(*nodes.T, *np.broadcast_to(anchor, nodes.shape).T)[2]
        nearest_m = float(np.min(away_m))
    else:
        raise InputError("holds no roads", file=extract.path, expected="ways with their nodes")
    if nearest_m == 0.0:
        return
    away = f"{nearest_m / 1000:.1f} km" if nearest_m >= 1000 else f"{nearest_m:.0f} m"
    raise InputError(
        f"has no road within {named}: the nearest is {away} away from it",
        file=extract.path,
        expected=expected,
    )
