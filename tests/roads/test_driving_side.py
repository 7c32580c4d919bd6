import pytest

from urbantwin.roads import driving_side


@pytest.mark.parametrize(
    ("place", "latitude", "longitude", "side"),
    [
        ("Perth", -31.975, 115.898, "left"),
        ("London", 51.5, -0.12, "left"),
        ("Tokyo", 35.68, 139.76, "left"),
        ("Nairobi", -1.28, 36.82, "left"),
        ("Hong Kong", 22.3, 114.17, "left"),
        ("Shenzhen", 22.54, 114.06, "right"),
        ("Taipei", 25.05, 121.52, "right"),
        ("Helsinki", 60.17, 24.94, "right"),
        ("Oakland", 37.8, -122.3, "right"),
        ("mid-Atlantic", 0.0, -30.0, "right"),
    ],
)
def test_side_of_the_road(place, latitude, longitude, side):
    assert driving_side(latitude, longitude) == side
