"""Sunlight: noise that datasheets imply, and light by the sun's height."""

from dataclasses import replace

import numpy as np
import pytest

from urbantwin.lidar.catalogue import sensor
from urbantwin.lidar.returns import ReturnModel
from urbantwin.lidar.returns.sunlight import air_mass, daylight, sun_klx, sun_noise
from urbantwin.site.rig import Conditions, Effects


@pytest.fixture(scope="module")
def os1(ground_mesh, rig_of):
    return rig_of(ground_mesh(), {}).sensors[0]


def test_air_mass_of_kasten_and_youngs_table():
    """Their table: 1 in the zenith, 1.9939 at 30, 5.5841 at 10 and 10.3164 at 5 degrees."""
    for elevation, mass in ((90, 0.9997), (30, 1.9939), (10, 5.5841), (5, 10.3164)):
        assert air_mass(elevation) == pytest.approx(mass, abs=2e-3 * mass)


def test_a_high_sun_gives_the_datasheets_light_and_none_at_night():
    assert sun_klx(60.0) == pytest.approx(100, rel=0.02)
    assert sun_klx(-1.0) == 0
    assert daylight(-10.0) == 0
    assert daylight(None) == 1
    assert 0 < daylight(5.0) < daylight(20.0) < daylight(50.0) < 1.3


@pytest.mark.parametrize(("name", "b"), [("OS1-128", 3.02), ("HDL-64E", 1.53), ("OS2-128", 0.52)])
def test_noise_of_the_sun_is_what_makes_both_ranges_of_a_datasheet(name, b):
    one = sensor(name)
    found, fall = sun_noise(one)
    assert found == pytest.approx(b, abs=0.02)
    assert fall == pytest.approx(2)
    signal = 8 * (one.detection_range_10_m / one.detection_range_80_m) ** 2
    assert np.sqrt((1 + 0.8 * found) / (1 + 0.1 * found)) == pytest.approx(signal)


def test_a_datasheet_that_leaves_nothing_to_the_sun_has_another_exponent():
    one = sensor("OS0-128")
    b, fall = sun_noise(one)
    assert b == 0
    assert 8 * (one.detection_range_10_m / one.detection_range_80_m) ** fall == pytest.approx(1)


def test_night_is_better_than_noon_by_the_shot_noise(os1):
    """Strength at night over that in the datasheet's light: the root of the variances."""
    night = ReturnModel(os1, Conditions(sun_elevation_deg=-20.0))
    day = ReturnModel(os1)
    amplitude, range_m = np.array([0.1, 0.8], "f4"), np.array([45.0, 100.0], "f4")
    b, _ = sun_noise(os1.sensor)
    expected = np.sqrt(1 + b * amplitude)
    ratio = night.strength(amplitude, range_m) / day.strength(amplitude, range_m)
    np.testing.assert_allclose(ratio, expected, rtol=1e-5)
    lit = day.strength(amplitude, range_m, light=np.array([2.0, 0.0], "f4"))
    dark = night.strength(amplitude, range_m)
    assert lit[1] == pytest.approx(dark[1], rel=1e-5)
    assert lit[0] < day.strength(amplitude, range_m)[0]


def test_sun_turned_off_is_the_datasheets_light(os1):
    off = replace(os1, effects=Effects(sun=False))
    amplitude, range_m = np.full(9, 0.3, "f4"), np.linspace(5, 90, 9, dtype="f4")
    for ours, plain in zip(
        ReturnModel(off, Conditions(sun_elevation_deg=5.0)).answers(amplitude, range_m),
        ReturnModel(os1).answers(amplitude, range_m),
        strict=True,
    ):
        np.testing.assert_array_equal(ours, plain)
