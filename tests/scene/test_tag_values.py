import math

import pytest

from urbantwin.scene.tag_values import count_of, length_m_of, yaw_of_direction


@pytest.mark.parametrize(
    ("text", "metres"),
    [
        ("12", 12.0),
        ("12.5", 12.5),
        ("12,5", 12.5),
        ("12 m", 12.0),
        ("12m", 12.0),
        ("~7", 7.0),
        ("120 cm", 1.2),
        ("40'", 40 * 0.3048),
        ("40 ft", 40 * 0.3048),
        ("5'6\"", 66 * 0.0254),
        (" 3 meters ", 3.0),
    ],
)
def test_lengths_are_read_in_every_unit_that_mappers_use(text, metres):
    assert length_m_of(text) == pytest.approx(metres)


@pytest.mark.parametrize("text", [None, "", "high", "0", "-3", "3-5", "nan", "inf", "1e3", "12 km"])
def test_what_is_no_length_gives_none(text):
    assert length_m_of(text) is None


def test_counts():
    assert count_of("3") == 3
    assert count_of("2,5") == 2.5
    assert count_of("2;4") == 4
    assert count_of("2;attic") is None
    assert count_of("-1") is None
    assert count_of(None) is None


def test_directions_are_compass_bearings():
    assert yaw_of_direction("N") == pytest.approx(math.pi / 2)
    assert yaw_of_direction("90") == pytest.approx(0)
    assert yaw_of_direction("sw") == pytest.approx(math.radians(-135))
    assert yaw_of_direction("forward") is None
