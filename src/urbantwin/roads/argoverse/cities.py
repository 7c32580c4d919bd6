"""Origins of the cities of Argoverse 2: their x, y are metres from an origin in a UTM zone.

Source: argoverse/av2-api, ``src/av2/geometry/utm.py`` (``UTM_ZONE_MAP``,
``CITY_ORIGIN_LATLONG_DICT``): city coordinates and the origin's easting and northing add up to
those of the zone (WGS84, north).
"""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pyproj import Transformer

from urbantwin.errors import InputError
from urbantwin.roads.argoverse.file import EXPECTED, places_in, read_file

__all__ = ["anchor_of", "city_of", "is_placed", "lonlat_of"]

#: City -> UTM zone, latitude and longitude of its origin, degrees.
CITIES = {
    "ATX": (14, 30.27464237939507, -97.7404457407424),
    "DTW": (17, 42.29993066912924, -83.17555750783717),
    "MIA": (17, 25.77452579915163, -80.19656914449405),
    "PAO": (10, 37.416065, -122.13571963362166),
    "PIT": (17, 40.44177902989321, -80.01294377242584),
    "WDC": (18, 38.889377, -77.0355047439081),
}
#: ``log_map_archive_<log>____PIT_city_47896.json``.
_NAME = re.compile(r"_([A-Z]{3})(?:_city_[0-9]+)?\.json$")


def city_of(path: Path) -> str | None:
    """Return the city in a map's file name; ``None`` if it names no known city."""
    found = _NAME.search(path.name)
    return found[1] if found and found[1] in CITIES else None


def is_placed(path: Path) -> bool:
    """Whether a map's file name tells its place on Earth."""
    return city_of(path) is not None


def lonlat_of(city: str, xy: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return longitude and latitude (N, 2), degrees, of a city's x, y (N, 2), metres."""
    transformer, origin = _projection(city)
    x, y = (np.asarray(xy, float) + origin).T
    return np.column_stack(transformer.transform(x, y, direction="INVERSE"))


def anchor_of(path: Path) -> tuple[float, float]:
    """Return latitude and longitude of the middle of a map, degrees.

    Raises:
        InputError: not a map of Argoverse 2, or its name says no city that is known.
    """
    city = city_of(path)
    if city is None:
        raise InputError(
            "its name says no city of Argoverse 2", file=path, expected="..._PIT_city_47896.json"
        )
    xy = places_in(read_file(path))
    if not len(xy):
        raise InputError("has no lane segments", file=path, expected=EXPECTED)
    middle = (xy.min(axis=0) + xy.max(axis=0)) / 2
    longitude, latitude = lonlat_of(city, middle[None, :2])[0]
    return float(latitude), float(longitude)


@cache
def _projection(city: str) -> tuple[Transformer, NDArray[np.float64]]:
    zone, latitude, longitude = CITIES[city]
    transformer = Transformer.from_crs("EPSG:4326", f"EPSG:{32600 + zone}", always_xy=True)
    return transformer, np.array(transformer.transform(longitude, latitude))
