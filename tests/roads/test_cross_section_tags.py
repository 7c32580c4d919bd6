"""Cross sections against what the OSM wiki says that tags mean."""

import math

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from urbantwin.roads.cross_section import cross_section, reinterpreted
from urbantwin.roads.cross_section.from_tags import speed_of
from urbantwin.roads.cross_section.lane_tags import count, metres

MPH = 1609.344 / 3600


def section(tags, side="right", sidewalks="no", country="DE"):
    return cross_section(
        {"highway": "primary", **tags}, driving_side=side, sidewalks=sidewalks, country=country
    )


def kinds(lanes):
    return [lane.kind for lane in lanes]


def turns(lanes):
    return [";".join(lane.turns) for lane in lanes]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("3.5", 3.5), ("3,5", 3.5), ("3.5 m", 3.5), ("12'", 3.6576), ("10'6\"", 3.2004),
        ("350 cm", 3.5), ("11 ft", 3.3528), ("narrow", None), ("0", None), ("-3", None),
        ("", None), ("1e9", None), (None, None),
    ],
)  # fmt: skip
def test_lengths(text, expected):
    assert metres(text) == pytest.approx(expected) if expected else metres(text) is None


@pytest.mark.parametrize(("text", "expected"), [("2", 2), ("2;3", 2), ("1.5", 1), ("many", None)])
def test_counts(text, expected):
    assert count(text) == expected


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        ("50", 50 / 3.6), ("50 km/h", 50 / 3.6), ("30 mph", 30 * MPH), ("30mph", 30 * MPH),
        ("walk", 7 / 3.6), ("none", 130 / 3.6), ("DE:urban", 50 / 3.6), ("DE:rural", 100 / 3.6),
        ("DE:zone30", 30 / 3.6), ("DE:zone:30", 30 / 3.6), ("GB:nsl_single", 60 * MPH),
        ("GB:zone20", 20 * MPH), ("RU:urban", 60 / 3.6), ("AT:living_street", 7 / 3.6),
        ("50;30", 30 / 3.6), ("signals", None), ("variable", None), ("fast", None), ("0", None),
    ],
)  # fmt: skip
def test_speeds(value, expected):
    assert speed_of(value) == (pytest.approx(expected) if expected else None)


@pytest.mark.parametrize(
    ("tags", "forward", "backward"),
    [
        ({}, 1, 1),
        ({"lanes": "2"}, 1, 1),
        ({"lanes": "3"}, 2, 1),
        ({"lanes": "3", "lanes:backward": "2"}, 1, 2),
        ({"lanes": "5", "lanes:forward": "2"}, 2, 3),
        ({"lanes:forward": "3", "lanes:backward": "1"}, 3, 1),
        ({"lanes": "3", "turn:lanes:backward": "left|through"}, 1, 2),
        ({"lanes": "1"}, 1, 1),
        ({"oneway": "yes"}, 2, 0),
        ({"oneway": "yes", "lanes": "3"}, 3, 0),
        ({"oneway": "-1", "lanes": "3"}, 0, 3),
        ({"oneway": "reversible", "lanes": "2"}, 2, 0),
        ({"junction": "roundabout", "lanes": "2"}, 2, 0),
        ({"highway": "motorway", "lanes": "3"}, 3, 0),
        ({"highway": "residential", "oneway": "yes"}, 1, 0),
        ({"oneway": "yes", "lanes": "3", "busway": "opposite_lane"}, 2, 1),
        ({"oneway": "yes", "lanes": "3", "oneway:bus": "no", "lanes:backward": "1"}, 2, 1),
        ({"lanes": "a lot", "oneway": "maybe"}, 1, 1),
    ],
)
def test_lanes_of_each_direction(tags, forward, backward):
    found = section(tags)
    assert (len(found.forward), len(found.backward)) == (forward, backward)


def test_a_middle_lane_for_both_directions():
    found = section({"lanes": "5", "lanes:both_ways": "1"}, country="US")
    assert len(found.forward) + len(found.backward) == 5
    assert [lane.both_ways for lane in found.forward] == [True, False, False]
    assert found.forward[0].turns == ("left",)


def test_turns_are_in_order_from_the_middle_outwards():
    tags = {"lanes": "4", "lanes:forward": "3", "turn:lanes:forward": "left|through|through;right"}
    assert turns(section(tags).forward) == ["left", "through", "through;right"]
    # Where people drive on the left, the leftmost lane is the outermost.
    assert turns(section(tags, "left").forward) == ["through;right", "through", "left"]
    assert turns(section({"oneway": "yes", "turn:lanes": "left||"}).forward) == ["left", "", ""]


def test_widths_of_lanes():
    tags = {"oneway": "yes", "lanes": "3", "width:lanes": "2.8|3.0|3.4"}
    assert [lane.width for lane in section(tags).forward] == [2.8, 3.0, 3.4]
    assert [lane.width for lane in section(tags, "left").forward] == [3.4, 3.0, 2.8]
    # No lane is as narrow or as wide as these: they have the usual width.
    wrong = section({**tags, "width:lanes": "0.1|3.0|99"})
    assert [lane.width for lane in wrong.forward][1] == 3.0
    assert all(2.5 < lane.width < 4.0 for lane in wrong.forward)
    both = section({"lanes": "2", "width:lanes:forward": "3.6", "width:lanes:backward": "2.9"})
    assert (both.forward[0].width, both.backward[0].width) == (3.6, 2.9)


def test_the_width_of_the_road_is_shared():
    found = section({"lanes": "3", "width": "10.5"})
    assert [lane.width for lane in (*found.forward, *found.backward)] == [3.5] * 3
    # From curb to curb: cycle lanes and parked cars are in it.
    tags = {"lanes": "2", "width": "14", "cycleway:both": "lane", "cycleway:both:width": "1.5"}
    parked = {"parking:both": "lane", "parking:both:width": "2"}
    found = section({**tags, **parked})
    assert [lane.width for lane in found.forward] == [3.5, 1.5]
    assert section({"lanes": "2", "width": "300"}).forward[0].width == 3.25


def test_default_widths_differ_by_class_and_country():
    def lane(highway, country):
        return section({"highway": highway}, country=country).forward[0].width

    assert lane("motorway", "DE") == 3.75
    assert lane("residential", "DE") == 2.75
    assert lane("secondary", "US") == pytest.approx(3.3)
    assert lane("motorway", "US") > lane("secondary", "US") > lane("residential", "US")


def test_cycle_lanes_and_tracks():
    found = section({"cycleway:right": "lane", "cycleway:right:width": "1.7"})
    assert kinds(found.forward) == ["driving", "bicycle"]
    assert kinds(found.backward) == ["driving"]
    assert (found.forward[1].width, found.forward[1].track) == (1.7, False)
    assert "bicycle" not in found.forward[0].allowed
    assert "bicycle" in found.backward[0].allowed
    assert section({"cycleway:both": "track"}).backward[-1].track
    assert kinds(section({"cycleway": "lane", "oneway": "yes"}).backward) == []
    against = section({"cycleway": "opposite_lane", "oneway": "yes"})
    assert kinds(against.backward) == ["bicycle"]
    # On the left, the forward direction's own side is the left one.
    assert kinds(section({"cycleway:left": "lane"}, "left").forward) == ["driving", "bicycle"]
    assert "bicycle" not in kinds(section({"cycleway": "shared_lane"}).forward)
    inner = section({"oneway": "yes", "lanes": "2", "cycleway:left": "lane"})
    assert kinds(inner.forward) == ["bicycle", "driving", "driving"]


def test_bus_lanes():
    tags = {"oneway": "yes", "lanes": "3", "bus:lanes": "||designated", "access:lanes": "||no"}
    found = section(tags)
    assert kinds(found.forward) == ["driving", "driving", "bus"]
    assert set(found.forward[2].allowed) == {"bus", "bicycle"}
    assert kinds(section({"lanes": "4", "busway:right": "lane"}).forward) == ["driving", "bus"]


@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize(
    ("tags", "forward", "backward"),
    [
        ({"lanes": "2", "busway": "lane"}, ["driving", "bus"], ["driving", "bus"]),
        ({"lanes": "2", "lanes:bus": "2"}, ["driving", "bus"], ["driving", "bus"]),
        ({"lanes": "4", "busway": "lane"}, ["driving", "bus"], ["driving", "bus"]),
        ({"lanes": "2", "busway:SIDE": "lane"}, ["driving", "bus"], ["driving"]),
        ({"lanes": "1", "oneway": "yes", "busway": "lane"}, ["driving", "bus"], []),
        ({"lanes": "1", "oneway": "-1", "lanes:psv": "1"}, [], ["driving", "bus"]),
        ({"lanes": "2", "bus:lanes:forward": "designated"}, ["driving"], ["driving"]),
        (
            {"lanes": "3", "lanes:forward": "2", "bus:lanes:forward": "designated|designated"},
            ["driving", "bus"],
            ["driving"],
        ),
        # Closed to cars, by tags of the street or of its lanes: buses alone.
        ({"lanes": "2", "busway": "lane", "motor_vehicle": "no", "bus": "yes"}, ["bus"], ["bus"]),
        (
            {"lanes": "2", "bus:lanes:forward": "designated", "vehicle:lanes:forward": "no"},
            ["bus"],
            ["driving"],
        ),
        ({"lanes": "2", "busway": "lane", "motor_vehicle:forward": "no"}, ["bus"],
         ["driving", "bus"]),
        ({"oneway": "yes", "lanes": "2", "busway": "opposite_lane"}, ["driving"], ["bus"]),
    ],
)  # fmt: skip
def test_bus_lanes_shut_no_cars_out_of_a_street_that_is_open_to_them(tags, forward, backward, side):
    tags = {key.replace("SIDE", side): value for key, value in tags.items()}
    found = section(tags, side)
    assert (kinds(found.forward), kinds(found.backward)) == (forward, backward)
    for lane in (*found.forward, *found.backward):
        assert ("car" in lane.allowed) == (lane.kind == "driving")
        assert "bus" in lane.allowed
        assert lane.width > 2
    assert kinds(section({"lanes": "4", "lanes:psv:backward": "1"}).backward)[-1] == "bus"
    assert kinds(section({"oneway": "yes", "lanes": "2", "psv:lanes": "designated|"}).forward) == [
        "bus",
        "driving",
    ]


def test_a_cycle_lane_between_lanes_of_cars():
    tags = {
        "oneway": "yes", "lanes": "3", "turn:lanes": "left|through||right",
        "bicycle:lanes": "||designated|", "vehicle:lanes": "||no|", "cycleway:right": "lane",
    }  # fmt: skip
    found = section(tags)
    assert kinds(found.forward) == ["driving", "driving", "bicycle", "driving"]


def test_closed_lanes_and_vehicles():
    found = section({"oneway": "yes", "lanes": "2", "motorcycle:lanes": "no|yes", "hgv": "no"})
    assert "motorcycle" not in found.forward[0].allowed
    assert "motorcycle" in found.forward[1].allowed
    assert "truck" not in found.forward[0].allowed
    closed = section({"oneway": "yes", "lanes": "2", "access:lanes": "|no"})
    assert (kinds(closed.forward), closed.forward[1].allowed) == (["driving", "none"], ())


@pytest.mark.parametrize(
    ("tags", "side", "expected"),
    [
        # One-way, two lanes of 3 m: the line runs along the middle without a tag.
        ({"oneway": "yes"}, "right", 3.0),
        ({"oneway": "yes", "placement": "left_of:1"}, "right", 0.0),
        ({"oneway": "yes", "placement": "middle_of:1"}, "right", 1.5),
        ({"oneway": "yes", "placement": "right_of:1"}, "right", 3.0),
        ({"oneway": "yes", "placement": "right_of:2"}, "right", 6.0),
        ({"oneway": "yes", "placement": "right_of:7"}, "right", 3.0),
        # On the left, the middle of the road is the right border of these lanes.
        ({"oneway": "yes"}, "left", -3.0),
        ({"oneway": "yes", "placement": "left_of:1"}, "left", -6.0),
        ({"oneway": "yes", "placement": "right_of:1"}, "left", -3.0),
        # Two ways.
        ({"lanes:forward": "2", "lanes:backward": "2"}, "right", 0.0),
        ({"lanes:forward": "2", "lanes:backward": "1"}, "right", 1.5),
        ({"lanes:forward": "2", "lanes:backward": "1"}, "left", -1.5),
        ({"lanes:forward": "2", "lanes:backward": "1", "placement:forward": "left_of:1"},
         "right", 0.0),
        ({"lanes:forward": "2", "lanes:backward": "2", "placement:backward": "middle_of:1"},
         "right", -1.5),
        ({"lanes:forward": "2", "lanes:backward": "2", "placement:forward": "right_of:2"},
         "left", 0.0),
    ],
)  # fmt: skip
def test_placement(tags, side, expected):
    lanes = {"lanes": "2"} if "oneway" in tags else {}
    widths = {"width": str(3 * (2 if lanes else sum(int(tags[f"lanes:{d}"]) for d in
              ("forward", "backward"))))}  # fmt: skip
    found = section({**lanes, **widths, **tags}, side)
    assert found.middle == pytest.approx((expected, expected))


def test_a_transition_leaves_the_middle_open():
    assert section({"placement": "transition"}).middle == (None, None)


def test_parking():
    found = section({"parking:right": "lane", "parking:left": "lane",
                     "parking:left:orientation": "perpendicular"})  # fmt: skip
    assert (found.right.parking.orientation, found.right.parking.width) == ("parallel", 2.0)
    assert (found.left.parking.orientation, found.left.parking.width) == ("perpendicular", 5.0)
    former = section({"parking:lane:both": "diagonal"})
    assert former.left.parking == former.right.parking
    assert former.left.parking.orientation == "diagonal"
    assert section({"parking:lane:right": "no_stopping"}).right.parking is None
    assert section({"parking:both": "separate"}).right.parking is None
    half = section({"parking:right": "half_on_kerb", "parking:right:width": "2"})
    assert half.right.parking.width == 1.0


def test_shoulders_and_sidewalks():
    motorway = section({"highway": "motorway"})
    assert (motorway.right.shoulder, motorway.left.shoulder) == (2.5, 0.0)
    assert section({"shoulder": "both", "shoulder:width": "1.2"}).left.shoulder == 1.2
    assert section({"highway": "motorway", "shoulder": "no"}).right.shoulder == 0.0
    tags = {"sidewalk:left:width": "3.2", "sidewalk:both:width": "1.8"}
    found = section(tags, sidewalks="both")
    assert (found.left.sidewalk, found.right.sidewalk) == (3.2, 1.8)
    assert section({}, sidewalks="right").left.sidewalk == 0.0


def test_speed_of_each_direction_and_lane():
    found = section({"maxspeed:forward": "70", "maxspeed:backward": "30 mph"})
    assert found.forward[0].speed == pytest.approx(70 / 3.6)
    assert found.backward[0].speed == pytest.approx(30 * MPH)
    lanes = section({"oneway": "yes", "lanes": "2", "maxspeed:lanes": "100|80"}).forward
    assert [lane.speed for lane in lanes] == pytest.approx([100 / 3.6, 80 / 3.6])
    assert section({"highway": "living_street"}).forward[0].speed == pytest.approx(7 / 3.6)
    assert section({"maxspeed": "signals"}).forward[0].speed == pytest.approx(50 / 3.6)


VALUES = st.sampled_from(
    "yes no -1 1 2 3 4 17 left right both left|through|right || designated|| |no| lane track "
    "opposite_lane separate parallel diagonal perpendicular half_on_kerb right_of:1 left_of:2 "
    "middle_of:9 transition 3.5 12' 50 30mph none walk DE:urban signals roundabout reversible "
    "3|3 a;b|c -5 nan 1e400 no_stopping ; | :".split(" ")
) | st.text(max_size=12)
KEYS = st.sampled_from(
    [
        f"{key}{direction}"
        for key in (
            "oneway junction lanes turn:lanes width width:lanes placement cycleway busway "
            "bus:lanes psv:lanes lanes:psv bicycle:lanes vehicle:lanes access:lanes maxspeed "
            "maxspeed:lanes parking parking:lane shoulder sidewalk:both:width access "
            "bicycle foot hgv motorroad"
        ).split()
        for direction in ("", ":forward", ":backward", ":left", ":right", ":both", ":both_ways")
    ]
)


@settings(max_examples=250, deadline=None)
@given(
    st.dictionaries(KEYS, VALUES, max_size=8),
    st.sampled_from(["right", "left"]),
    st.sampled_from("motorway trunk primary residential living_street busway road".split()),
    st.sampled_from(["no", "left", "right", "both"]),
    st.sampled_from(["", "DE", "US", "AU", "TW", "GB"]),
)
def test_any_tags_give_a_road(tags, side, highway, sidewalks, country):
    found = cross_section(
        {**tags, "highway": highway}, driving_side=side, sidewalks=sidewalks, country=country
    )
    lanes = [*found.forward, *found.backward]
    assert any(lane.kind != "bicycle" for lane in lanes)
    assert all(0.5 < lane.width <= 8.0 for lane in lanes)
    assert all(0.2 < lane.speed < 100 for lane in lanes)
    assert found.width == pytest.approx(sum(lane.width for lane in lanes if not lane.track))
    assert all(offset is None or math.isfinite(offset) for offset in found.middle)
    for beside, name in ((found.left, "left"), (found.right, "right")):
        assert (beside.sidewalk > 0) == (sidewalks in (name, "both"))


def mirrored(text):
    """Left for right, and lists of lanes the other way round."""
    swapped = text.replace("left", "\0").replace("right", "left").replace("\0", "right")
    return "|".join(swapped.split("|")[::-1])


@example({"lanes": "4", "busway:right": "lane"}, "primary")
@example({"lanes": "3", "turn:lanes:forward": "left|through", "width:lanes": "3|4|5"}, "primary")
@example({"oneway": "yes", "cycleway:left": "track", "oneway:bicycle": "no"}, "residential")
@settings(max_examples=200, deadline=None)
@given(
    st.dictionaries(KEYS.filter(lambda key: "placement" not in key), VALUES, max_size=6),
    st.sampled_from("motorway primary residential".split()),
)
def test_left_hand_traffic_is_the_mirror_image(tags, highway):
    tags = {**tags, "highway": highway}
    there = {mirrored(key): mirrored(value) for key, value in tags.items()}
    right = cross_section(tags, driving_side="right", sidewalks="right", country="DE")
    left = cross_section(there, driving_side="left", sidewalks="left", country="DE")
    assert (left.left, left.right) == (right.right, right.left)
    for here, other in ((right.forward, left.forward), (right.backward, left.backward)):
        assert kinds(here) == kinds(other)
        assert [lane.width for lane in here] == [lane.width for lane in other]
        assert [lane.allowed for lane in here] == [lane.allowed for lane in other]
        assert [sorted(lane.turns) for lane in here] == [
            sorted(mirrored(turn) for turn in lane.turns) for lane in other
        ]
    assert right.middle == pytest.approx(tuple(-m for m in left.middle))


@pytest.mark.parametrize(
    ("tags", "shared", "width"),
    [
        ({"lanes": "1"}, True, 3.5),
        ({"lanes": "1", "width": "4"}, True, 4.0),
        ({"lanes": "1", "width": "3"}, True, 3.0),
        ({"lanes": "1", "width": "2.4"}, True, 2.4),
        ({"lanes": "1", "width:lanes": "3.2"}, True, 3.2),
        # Parked cars stand on it: 2.0 m on each side (RASt 06).
        ({"lanes": "1", "width": "7", "parking:both": "lane"}, True, 3.0),
        ({"lanes": "1", "width": "9", "parking:both": "lane"}, False, 5.0),
        ({"oneway": "alternating"}, True, 3.5),
        ({"lanes": "1", "cycleway:both": "track"}, True, 3.5),
        # Wide enough that two cars meet without waiting (RASt 06, 4.75 m; 4.10 m at low speed).
        ({"lanes": "1", "width": "5.5"}, False, 5.5),
        ({"lanes": "1.5"}, False, 4.5),
        ({"lanes": "2"}, False, 5.5),
        ({"lanes": "1", "lanes:forward": "1", "lanes:backward": "1"}, False, 4.5),
        ({"lanes": "1", "oneway": "yes"}, False, 2.75),
    ],
)
@pytest.mark.parametrize("side", ["right", "left"])
def test_one_lane_for_both_directions(tags, shared, width, side):
    """OSM wiki, "Key:lanes": the lanes of a street of both directions are counted together."""
    found = section({"highway": "residential", **tags}, side)
    assert found.one_lane is shared
    assert found.width == pytest.approx(width)
    if shared:
        ahead, back = found.forward[0], found.backward[0]
        assert (len(found.forward), len(found.backward)) in ((1, 1), (2, 2))
        assert ahead.width == back.width == pytest.approx(width / 2)


@pytest.mark.parametrize(
    ("tags", "words"),
    [
        ({"oneway": "reversible"}, "traffic runs as the way is drawn"),
        ({"oneway": "alternating", "lanes": "2"}, "nobody waits"),
        ({"oneway": "maybe"}, "taken for no"),
        ({"lanes": "3", "lanes:both_ways": "1"}, "a turning lane"),
        ({"oneway": "yes", "oneway:bicycle": "no"}, "bicycles ride with the traffic only"),
        ({"oneway": "yes", "cycleway": "opposite"}, "cycleway=opposite: bicycles"),
        ({"lanes": "4", "lanes:forward": "2", "lanes:backward": "1"}, "lanes=4, but lanes:forward"),
        ({"lanes": "2", "lanes:forward": "3"}, "lanes=2, but lanes:forward=3"),
        ({"lanes": "2", "oneway": "yes", "lanes:forward": "3"}, "the parts are taken"),
        ({"lanes": "2", "oneway": "yes", "turn:lanes": "left|through|right"}, "3 values for 2"),
        # As they say.
        ({}, None),
        ({"lanes": "1"}, None),
        ({"oneway": "alternating"}, None),
        ({"oneway": "yes", "oneway:bicycle": "no", "cycleway:left": "lane"}, None),
        ({"oneway": "yes", "cycleway": "opposite_lane"}, None),
        ({"lanes": "3", "lanes:forward": "2", "lanes:backward": "1"}, None),
        ({"lanes": "3", "lanes:forward": "1"}, None),
        ({"lanes": "2", "oneway": "yes", "turn:lanes": "left|through"}, None),
        (
            {"lanes": "2", "oneway": "yes", "turn:lanes": "left|none|through"}
            | {"bicycle:lanes": "|designated|", "vehicle:lanes": "|no|"},
            None,
        ),
    ],
)
def test_what_is_taken_otherwise_is_said_once(tags, words):
    said = reinterpreted({"highway": "primary", **tags}, section(tags))
    assert (said == []) if words is None else (len(said) == 1 and words in said[0])


def test_a_turning_lane_in_the_middle_counts_by_its_turns():
    """OSM wiki, "Key:lanes": lanes = lanes:forward + lanes:backward + lanes:both_ways."""
    tags = {"lanes": "5", "lanes:forward": "2", "lanes:backward": "2"}
    found = section({**tags, "turn:lanes:both_ways": "left"})
    assert (len(found.forward), len(found.backward)) == (3, 2)
    assert [lane.both_ways for lane in found.forward] == [True, False, False]
    assert reinterpreted(tags, section(tags)) != []
