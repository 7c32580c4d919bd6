import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyproj import Geod

from urbantwin.geometry import SiteFrame

LATITUDES = st.floats(-80, 80)
LONGITUDES = st.floats(-179, 179)


@given(LATITUDES, LONGITUDES, st.floats(-180, 180), st.floats(1, 2000))
def test_distance_and_bearing_are_the_ellipsoids(latitude, longitude, bearing, distance):
    """Against the geodesic of the WGS84 ellipsoid, which knows no projection."""
    lon, lat, _ = Geod(ellps="WGS84").fwd(longitude, latitude, bearing, distance)
    xy = SiteFrame(latitude, longitude).site_from_lonlat([[lon, lat]])[0]
    angle = np.radians(bearing)
    expected = distance * np.array([np.sin(angle), np.cos(angle)])
    assert xy == pytest.approx(expected, abs=2e-3 * distance / 100 * np.cosh(np.radians(latitude)))


@given(LATITUDES, LONGITUDES, st.floats(-2000, 2000), st.floats(-2000, 2000))
def test_there_and_back(latitude, longitude, east, north):
    frame = SiteFrame(latitude, longitude)
    again = frame.site_from_lonlat(frame.lonlat_from_site([[east, north]]))[0]
    assert again == pytest.approx([east, north], abs=1e-5)


def test_the_anchor_is_the_origin():
    assert SiteFrame(60.17, 24.94).site_from_lonlat([[24.94, 60.17]])[0] == pytest.approx(
        [0, 0], abs=1e-9
    )
