"""Who may use a way, against the tree of classes in the OSM wiki ("Key:access")."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from urbantwin.site.access import either_way, is_driven, is_walked, opened, permission_of

#: The wiki's "Land-based transportation": each class and the wider one that it belongs to.
WIDER = {
    "foot": "access", "vehicle": "access", "bicycle": "vehicle", "motor_vehicle": "vehicle",
    "motorcar": "motor_vehicle", "motorcycle": "motor_vehicle", "goods": "motor_vehicle",
    "hgv": "motor_vehicle", "psv": "motor_vehicle", "bus": "psv",
}  # fmt: skip
#: Our classes of actors by theirs; lorries are heavy and light.
OURS = {"motorcar": "car", "bus": "bus", "motorcycle": "motorcycle", "bicycle": "bicycle"}
VALUES = "yes no private destination designated permissive delivery customers agricultural".split()
MAY = {"yes", "destination", "designated", "permissive"}


def users(highway="residential", **tags):
    return set(permission_of({"highway": highway, **tags}, walkers_on_lanes=True).motor)


def as_the_tree_says(tags, name):
    """The value of the narrowest class that is tagged, looked for from the widest down."""
    path = [name]
    while path[0] in WIDER:
        path.insert(0, WIDER[path[0]])
    value = "yes"
    for key in path:
        value = tags.get(key, value)
    return value in MAY


@settings(max_examples=300, deadline=None)
@given(st.dictionaries(st.sampled_from([*WIDER, "access"]), st.sampled_from(VALUES), max_size=5))
def test_a_narrower_class_overrides_a_wider_one(tags):
    found = users(**tags)
    for theirs, ours in OURS.items():
        assert (ours in found) == as_the_tree_says(tags, theirs), (tags, theirs)
    assert ("pedestrian" in found) == as_the_tree_says(tags, "foot")
    if "goods" not in tags:
        assert ("truck" in found) == as_the_tree_says(tags, "hgv")


MOTOR = {"car", "truck", "bus", "motorcycle"}


@pytest.mark.parametrize(
    ("tags", "expected"),
    [
        ({"access": "no"}, set()),
        ({"access": "no", "foot": "yes", "bicycle": "yes"}, {"bicycle", "pedestrian"}),
        ({"vehicle": "no"}, {"pedestrian"}),
        ({"vehicle": "no", "bus": "yes"}, {"bus", "pedestrian"}),
        ({"motor_vehicle": "no", "psv": "designated"}, {"bus", "bicycle", "pedestrian"}),
        ({"motor_vehicle": "private", "access": "yes"}, {"bicycle", "pedestrian"}),
        ({"motor_vehicle": "bus"}, {"bus", "bicycle", "pedestrian"}),
        ({"motor_vehicle": "destination"}, {*MOTOR, "bicycle", "pedestrian"}),
        (
            {"motor_vehicle": "no", "motor_vehicle:conditional": "yes @ (18:00-08:00)"},
            {"bicycle", "pedestrian"},
        ),
        ({"access": "no", "motor_vehicle": "yes"}, MOTOR),
        ({"highway": "busway"}, {"bus", "bicycle", "pedestrian"}),
        ({"highway": "trunk", "access": "yes"}, MOTOR),
        ({"highway": "trunk"}, MOTOR),
        ({"hgv": "delivery"}, {"car", "bus", "motorcycle", "bicycle", "pedestrian"}),
    ],
)
def test_who_may_pass_through(tags, expected):
    assert users(**tags) == expected


def test_a_direction_has_a_word_of_its_own():
    tags = {"highway": "residential", "motor_vehicle:backward": "no", "bus:backward": "yes"}
    back = permission_of(tags, walkers_on_lanes=False, direction="backward")
    assert set(back.motor) == {"bus", "bicycle"}
    assert permission_of(tags, walkers_on_lanes=False, direction="forward").cars
    assert is_driven(tags)
    assert not is_driven({"highway": "primary", "vehicle": "no"})


def test_streets_of_some_are_open_to_those():
    tags = {"highway": "service", "access": "private", "name": "private", "bus": "no"}
    assert opened(tags) == {**tags, "access": "yes"}


@pytest.mark.parametrize(
    ("tags", "either"),
    [
        ({"motor_vehicle:backward": "no"}, {}),
        ({"motor_vehicle": "no"}, {"motor_vehicle": "no"}),
        ({"motor_vehicle": "no", "motor_vehicle:forward": "yes"}, {"motor_vehicle": "yes"}),
        ({"motor_vehicle": "no", "bus:forward": "yes"}, {"motor_vehicle": "no", "bus": "yes"}),
        ({"access:forward": "no", "access:backward": "private"}, {"access": "no"}),
    ],
)
def test_a_road_that_leads_out_and_back_is_for_all_who_may_either(tags, either) -> None:
    assert either_way(tags) == either


@pytest.mark.parametrize(
    ("tags", "walked"),
    [
        ({"highway": "footway"}, True),
        ({"highway": "cycleway"}, False),
        ({"highway": "cycleway", "foot": "designated"}, True),
        ({"highway": "path", "access": "private"}, False),
        ({"highway": "path", "access": "private", "foot": "yes"}, True),
        ({"highway": "footway", "foot": "use_sidepath"}, False),
        ({"highway": "residential", "vehicle": "no"}, True),
        ({"highway": "primary", "motorroad": "yes"}, False),
    ],
)
def test_people_walk_where_the_map_lets_them(tags, walked) -> None:
    assert is_walked(tags) is walked
