"""Area of acquisition: parsing of coordinates, and a circle around them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
import tzfpy
from numpy.typing import NDArray
from pyproj import CRS, Transformer

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.site.extract_file import LonLatBox
from urbantwin.site.region import FARTHEST_M, circle

__all__ = ["Area", "may_be_swapped", "parse_place", "swapped_hint"]

#: Smallest radius, metres; no junction fits into a smaller one.
LEAST_RADIUS_M = 20.0
#: Highest absolute latitude with map data, degrees.
_FARTHEST_NORTH = 85.0
_NUMBER = r"\s*([-+]?[0-9]{1,3}(?:\.[0-9]*)?)\s*°?\s*"


@dataclass(frozen=True)
class Area:
    """A circle on the earth.

    Attributes:
        latitude: latitude of the centre, degrees, WGS84.
        longitude: longitude of the centre, degrees, WGS84.
        radius_m: radius, metres.
    """

    latitude: float
    longitude: float
    radius_m: float

    @classmethod
    def checked(cls, latitude: float, longitude: float, radius_m: float) -> Area:
        """Return the area around coordinates.

        Raises:
            InputError: the coordinates are out of range, swapped, near a pole or in the sea, or the
                radius is out of range.
        """
        if not LEAST_RADIUS_M <= radius_m <= FARTHEST_M:
            raise InputError(
                f"is {radius_m:g} m",
                place="--radius",
                expected=f"{LEAST_RADIUS_M:g} to {FARTHEST_M:g} m",
            )
        here = f"{latitude:g},{longitude:g}"
        if not (-90.0 <= latitude <= 90.0 and -180.0 <= longitude <= 180.0):
            fits = abs(longitude) <= 90.0 and abs(latitude) <= 180.0
            raise InputError(
                f"{here} is out of range",
                place="--at",
                expected=swapped_hint(latitude, longitude)
                if fits
                else "LAT,LON in degrees: -90 to 90, -180 to 180",
            )
        if abs(latitude) > _FARTHEST_NORTH:
            raise InputError(
                f"{here} is near a pole",
                place="--at",
                expected=f"a latitude of at most {_FARTHEST_NORTH:g}",
            )
        if _at_sea(latitude, longitude):
            swapped = may_be_swapped(latitude, longitude)
            raise InputError(
                f"{here} is in the sea",
                place="--at",
                expected=swapped_hint(latitude, longitude) if swapped else "a place on land",
            )
        return cls(latitude, longitude, radius_m)

    @cached_property
    def frame(self) -> SiteFrame:
        """The site frame: east-north-up metres at the centre."""
        return SiteFrame(self.latitude, self.longitude)

    @cached_property
    def circle(self) -> shapely.Polygon:
        """The circle in the site frame, metres."""
        return circle(self.radius_m)

    def outline(self, margin_m: float) -> NDArray[np.float64]:
        """Return points (N, 2) on the square around the circle: longitude, latitude, degrees."""
        half = self.radius_m + margin_m
        square = shapely.segmentize(shapely.box(-half, -half, half, half), half / 4)
        return self.frame.lonlat_from_site(shapely.get_coordinates(square))

    def box(self, margin_m: float) -> LonLatBox:
        """Return west, south, east, north of that square, degrees."""
        points = self.outline(margin_m)
        (west, south), (east, north) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
        return west, south, east, north

    def box_in(self, crs: str, margin_m: float) -> tuple[float, float, float, float]:
        """Return the least and greatest x and y of that square in another CRS.

        Raises:
            pyproj.exceptions.CRSError: the CRS is invalid.
            ValueError: the square is outside of the CRS's domain.
        """
        system = CRS.from_user_input(crs)
        plan = system.sub_crs_list[0] if system.is_compound else system.to_2d()
        to = Transformer.from_crs("EPSG:4326", plan, always_xy=True)
        x, y = to.transform(*self.outline(margin_m).T)
        if not (np.isfinite(x).all() and np.isfinite(y).all()):
            raise ValueError("the place is beyond the CRS")
        return float(np.min(x)), float(np.min(y)), float(np.max(x)), float(np.max(y))

    def degrees(self, margin_m: float) -> Iterator[tuple[int, int]]:
        """Yield south and west of every one-degree square that the area intersects."""
        west, south, east, north = (int(np.floor(one)) for one in self.box(margin_m))
        for latitude in range(south, north + 1):
            for longitude in range(west, east + 1):
                yield latitude, longitude


def parse_place(text: str) -> tuple[float, float]:
    """Return the latitude and longitude of a text ``LAT,LON``, degrees.

    Raises:
        InputError: the text is not two numbers.
    """
    told = re.fullmatch(_NUMBER + r"[,;\s]" + _NUMBER, text, re.ASCII)
    if told is None:
        raise InputError(
            f"is {text!r:.60}", place="--at", expected="LAT,LON in degrees, such as 48.1374,11.5755"
        )
    return float(told[1]), float(told[2])


def may_be_swapped(latitude: float, longitude: float) -> bool:
    """Return whether there is land at the swapped coordinates."""
    return abs(longitude) <= _FARTHEST_NORTH and not _at_sea(longitude, latitude)


def swapped_hint(latitude: float, longitude: float) -> str:
    """Return a hint for coordinates that seem to be swapped."""
    return f"latitude first: --at {longitude:g},{latitude:g}"


def _at_sea(latitude: float, longitude: float) -> bool:
    """Return whether a place is outside of all territorial waters (nautical time zones only)."""
    return str(tzfpy.get_tz(longitude, latitude)).startswith("Etc/")
