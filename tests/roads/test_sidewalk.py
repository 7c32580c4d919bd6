import numpy as np
import pytest
import shapely

from urbantwin.roads.sidewalk import sidewalk_sides

EAST = np.array([[0.0, 0.0], [100.0, 0.0]])


@pytest.mark.parametrize(
    ("tags", "expected"),
    [
        ({"highway": "residential"}, "both"),
        ({"highway": "residential", "sidewalk": "left"}, "left"),
        ({"highway": "residential", "sidewalk": "separate"}, "both"),
        ({"highway": "residential", "sidewalk": "none"}, "no"),
        ({"highway": "residential", "sidewalk:both": "no"}, "no"),
        ({"highway": "residential", "sidewalk:left": "no", "sidewalk:right": "separate"}, "right"),
        ({"highway": "primary", "sidewalk:left": "yes", "sidewalk:right": "yes"}, "both"),
        ({"highway": "motorway"}, "no"),
        ({"highway": "trunk"}, "no"),
        ({"highway": "trunk", "sidewalk": "right"}, "right"),
        ({"highway": "primary", "foot": "no"}, "no"),
        ({"highway": "primary", "junction": "roundabout"}, "right"),
        ({"highway": "primary", "foot": "use_sidepath"}, "both"),
    ],
)
def test_tags(tags, expected):
    assert sidewalk_sides(tags, EAST, [], side="right") == expected


def test_a_dual_carriageway_has_only_its_outer_sidewalk():
    tags = {"highway": "primary", "oneway": "yes"}
    against_on_the_left = shapely.LineString(EAST[::-1] + [0, 12.0])
    along_on_the_left = shapely.LineString(EAST + [0, 12.0])
    against_far_away = shapely.LineString(EAST[::-1] + [0, 60.0])
    assert sidewalk_sides(tags, EAST, [against_on_the_left], side="right") == "right"
    assert sidewalk_sides(tags, EAST, [along_on_the_left], side="right") == "both"
    assert sidewalk_sides(tags, EAST, [against_far_away], side="right") == "both"
    # Where people drive on the left, the other carriageway is on the right.
    against_on_the_right = shapely.LineString(EAST[::-1] - [0, 12.0])
    assert sidewalk_sides(tags, EAST, [against_on_the_right], side="left") == "left"
    assert sidewalk_sides(tags, EAST, [against_on_the_left], side="left") == "both"


@pytest.mark.parametrize(
    ("tags", "sides"),
    [
        ({"access": "private"}, "both"),
        ({"foot": "use_sidepath"}, "both"),
        ({"foot": "no"}, "no"),
        ({"motorroad": "yes"}, "no"),
    ],
)
def test_a_street_that_is_closed_to_through_traffic_has_its_sidewalks(tags, sides) -> None:
    """People cross the mouth of a private street in Munich from one to the other."""
    line = np.array([[0.0, 0.0], [50.0, 0.0]])
    assert sidewalk_sides({"highway": "unclassified", **tags}, line, [], side="right") == sides
