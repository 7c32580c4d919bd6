"""Places in the OpenStreetMap editor."""

from __future__ import annotations

import numpy as np
import shapely

from urbantwin.geometry import SiteFrame
from urbantwin.weakness.finding import Spot

__all__ = ["editor_link", "spot"]


def editor_link(latitude: float, longitude: float, element: str = "") -> str:
    """Return the address of a place in the editor iD, with an element of the map selected.

    Args:
        latitude: degrees, WGS84.
        longitude: degrees, WGS84.
        element: ``node/1``, ``way/1`` or ``relation/1``.
    """
    kind, _, number = element.partition("/")
    selected = f"&{kind}={number}" if number else ""
    return (
        f"https://www.openstreetmap.org/edit?editor=id{selected}"
        f"#map=19/{latitude:.6f}/{longitude:.6f}"
    )


def spot(frame: SiteFrame, shape: shapely.Geometry, *, element: str = "", name: str = "") -> Spot:
    """Return the place of something in the site frame: a point that lies on it.

    Args:
        frame: the site frame.
        shape: in the site frame.
        element: of the map.
        name: what it is, in words.
    """
    point = shape
    if shape.geom_type == "LineString":
        point = shape.interpolate(0.5, normalized=True)
    elif shape.geom_type != "Point":
        point = shape.representative_point()
    xy = np.array([[point.x, point.y]])
    longitude, latitude = (float(value) for value in frame.lonlat_from_site(xy)[0])
    return Spot(
        float(point.x),
        float(point.y),
        latitude,
        longitude,
        element,
        name,
        editor_link(latitude, longitude, element),
    )
