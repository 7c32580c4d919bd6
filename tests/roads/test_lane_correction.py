"""Lanes added to tags and removed from them, against the cross sections that tags describe."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from urbantwin.roads.cross_section.lane_correction import (
    ImpossibleLaneError,
    Street,
    with_lane,
    without_lane,
)

RIGHT, LEFT = Street("right", "both", "DE"), Street("left", "both", "GB")
STREETS = [
    {"highway": "residential"},
    {"highway": "secondary", "lanes": "3", "turn:lanes:forward": "left|through", "width": "11"},
    {"highway": "secondary", "oneway": "yes", "lanes": "2", "turn:lanes": "left|through;right"},
    {"highway": "primary", "oneway": "-1", "lanes": "2"},
    {"highway": "secondary", "lanes": "4", "bus:lanes:forward": "yes|designated"},
    {
        "highway": "tertiary",
        "lanes": "2",
        "cycleway": "lane",
        "parking:both": "lane",
        "width": "12",
    },
    {"highway": "tertiary", "lanes": "4", "lanes:psv": "2", "placement:forward": "right_of:1"},
    {"highway": "secondary", "lanes": "3", "lanes:both_ways": "1"},
]


def lanes(section):
    """Kinds and widths from left to right, as seen along the way."""
    ahead = [(lane.kind, round(lane.width, 3), 1) for lane in section.forward]
    back = [(lane.kind, round(lane.width, 3), -1) for lane in section.backward]
    return [*back[::-1], *ahead] if section.outward < 0 else [*ahead[::-1], *back]


def left_border(section):
    """How far the left border of the carriageway lies to the left of the way."""
    left = section.backward if section.outward < 0 else section.forward
    return section.middle[0] + sum(lane.width for lane in left)


@pytest.mark.parametrize("tags", STREETS)
@pytest.mark.parametrize("street", [RIGHT, LEFT])
@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("kind", ["driving", "bus", "bicycle"])
def test_a_lane_is_added_at_one_side_and_the_other_side_stays(tags, street, side, kind):
    before = street.section(tags)
    try:
        after = street.section(with_lane(tags, side, kind, 2.75, street))
    except ImpossibleLaneError:
        assert kind == "bicycle"  # the one that is there
        return
    was, now = lanes(before), lanes(after)
    assert len(now) == len(was) + 1
    if side == "left":
        was, now = was[::-1], now[::-1]
    place = -2 if was[-1][0] == "bicycle" else -1  # a cycle lane stays at the curb
    assert now[place][:2] == (kind, 2.75)
    del now[place]
    assert now == was
    grown = 2.75 if side == "left" else 0.0
    assert left_border(after) == pytest.approx(left_border(before) + grown, abs=1e-3)


@pytest.mark.parametrize("tags", STREETS)
@pytest.mark.parametrize("street", [RIGHT, LEFT])
@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("kind", ["driving", "bus", "bicycle"])
def test_a_lane_that_was_added_can_be_removed(tags, street, side, kind):
    before = street.section(tags)
    try:
        more = with_lane(tags, side, kind, 2.75, street)
    except ImpossibleLaneError:
        return
    after = street.section(without_lane(more, side, kind, street))
    assert lanes(after) == lanes(before)
    assert left_border(after) == pytest.approx(left_border(before), abs=1e-3)
    assert [lane.turns for lane in after.forward] == [lane.turns for lane in before.forward]


@pytest.mark.parametrize("kind", ["parking", "shoulder"])
def test_lanes_beside_the_carriageway(kind):
    plain = {"highway": "residential", "width": "6"}
    more = with_lane(plain, "left", kind, 2.2, RIGHT)
    section = RIGHT.section(more)
    beside = section.left.parking.width if kind == "parking" else section.left.shoulder
    assert beside == pytest.approx(2.2)
    assert section.right.parking is None
    assert section.right.shoulder == 0
    assert lanes(section) == lanes(RIGHT.section(plain))
    with pytest.raises(ImpossibleLaneError, match="already"):
        with_lane(more, "left", kind, 2.2, RIGHT)
    assert lanes(RIGHT.section(without_lane(more, "left", kind, RIGHT))) == lanes(section)


def test_both_sides_said_at_once_are_told_apart():
    tags = {
        "highway": "residential",
        "parking:both": "lane",
        "parking:both:orientation": "diagonal",
    }
    section = RIGHT.section(without_lane(tags, "right", "parking", RIGHT))
    assert section.right.parking is None
    assert section.left.parking.orientation == "diagonal"


def test_the_last_lane_of_a_direction_stays():
    with pytest.raises(ImpossibleLaneError, match="only lane of its direction"):
        without_lane({"highway": "residential"}, "right", "driving", RIGHT)
    with pytest.raises(ImpossibleLaneError, match="no lane of kind bus"):
        without_lane({"highway": "residential"}, "right", "bus", RIGHT)


@given(
    st.dictionaries(
        st.sampled_from(
            ["lanes", "lanes:forward", "lanes:backward", "oneway", "turn:lanes", "bus:lanes",
             "width", "width:lanes:forward", "cycleway", "cycleway:left", "parking:both",
             "sidewalk", "lanes:bus", "placement", "shoulder", "lanes:both_ways", "vehicle:lanes"]
        ),
        st.sampled_from(["1", "2", "3", "yes", "no", "-1", "lane", "track", "left|through", "|",
                         "a|b|c", "designated|", "right_of:1", "9", "", "separate", "1.5;2"]),
    ),
    st.sampled_from(["left", "right"]),
    st.sampled_from(["driving", "bus", "bicycle", "parking", "shoulder", "sidewalk"]),
    st.sampled_from([RIGHT, LEFT]),
    st.booleans(),
)  # fmt: skip
def test_whatever_the_tags_are(tags, side, kind, street, add):
    tags = {"highway": "secondary", **tags}
    before = lanes(street.section(tags))
    try:
        if add:
            after = with_lane(tags, side, kind, None, street)
        else:
            after = without_lane(tags, side, kind, street)
    except ImpossibleLaneError:
        return
    if kind in ("driving", "bus"):
        grown = len(lanes(street.section(after))) - len(before)
        assert grown == (1 if add else -1)
