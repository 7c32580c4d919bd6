"""What holds only at times: as opening_hours and the OSM wiki's examples have it."""

from pathlib import Path

import pytest

from urbantwin.site.conditional_tags import at_time
from urbantwin.site.extract import Extract, Relation, Way


def extract(**tags: str) -> Extract:
    """A street, and a restriction of turns, with the same tags."""
    named = {key.replace("__", ":"): value for key, value in tags.items()}
    way = Way(1, (1, 2), {"highway": "residential", **named})
    turn = Relation(2, (("w", 1, "from"),), {"type": "restriction", **named})
    return Extract(Path("map.osm"), {}, {}, {1: way}, {2: turn}, None)


@pytest.mark.parametrize(
    ("rule", "times"),
    [
        ("no @ (Mo-Fr 07:00-19:00)", {"06:59": None, "07:00": "no", "18:59": "no", "19:00": None}),
        ("no @ Mo-Fr 07:00-19:00", {"12:00": "no", "20:00": None}),
        ("no @ (Mo-Fr 07:00-09:00,16:00-18:00)", {"08:00": "no", "12:00": None, "17:00": "no"}),
        ("no @ (22:00-06:00)", {"23:30": "no", "05:59": "no", "12:00": None}),
        ("no @ (Sa,Su)", {"12:00": None}),
        ("no @ (Sa-We 10:00-11:00)", {"10:30": "no"}),
        ("no @ (Mo-Fr 09:00-18:00; Sa 09:00-14:00)", {"10:00": "no", "20:00": None}),
        # Of several values the last that holds counts.
        ("no @ (Mo-Su); delivery @ (06:00-10:00)", {"08:00": "delivery", "12:00": "no"}),
        ("private @ (06:00-10:00); no @ (10:00-24:00)", {"08:00": "private", "23:00": "no"}),
    ],
)  # fmt: skip
def test_a_street_is_closed_when_the_map_says_so(rule: str, times: dict[str, str | None]) -> None:
    for time, value in times.items():
        found, left = at_time(extract(motor_vehicle__conditional=rule), time)
        assert found.ways[1].tags.get("motor_vehicle") == value, time
        assert left == []


def test_the_value_at_other_times_stays() -> None:
    tags = {"access__forward__conditional": "no @ (07:00-09:00)", "access__forward": "destination"}
    assert at_time(extract(**tags), "08:00")[0].ways[1].tags["access:forward"] == "no"
    assert at_time(extract(**tags), "10:00")[0].ways[1].tags["access:forward"] == "destination"


def test_turns_are_forbidden_at_their_times() -> None:
    """As two of Taipei's are."""
    made = extract(restriction__conditional="no_left_turn @ (Mo-Fr 07:00-22:00)")
    assert at_time(made, "12:00")[0].relations[2].tags["restriction"] == "no_left_turn"
    assert "restriction" not in at_time(made, "23:00")[0].relations[2].tags


@pytest.mark.parametrize(
    ("rule", "time"),
    [
        ("no @ (Mo-Fr 07:00-19:00)", None),
        ("no @ (weight>7.5)", "12:00"),
        ("no @ (sunset-sunrise)", "12:00"),
        ("no @ (PH)", "12:00"),
        ("no @ (Dec 01-Mar 31)", "12:00"),
        ("no", "12:00"),
        ("@@;(", "12:00"),
    ],
)
def test_what_is_not_understood_leaves_a_street_as_it_is_and_is_told(
    rule: str, time: str | None
) -> None:
    found, left = at_time(extract(access__conditional=rule), time)
    assert "access" not in found.ways[1].tags
    assert left == [f"access:conditional={rule}"]


def test_what_is_said_of_parking_is_no_restriction_of_turns() -> None:
    """As three streets of Neukölln have it."""
    made = extract(restriction__conditional="loading_only @ (Mo-Fr 07:00-17:00)")
    assert at_time(made, "08:00")[0].ways[1].tags.get("restriction") is None
    assert len(at_time(made, None)[1]) == 1, "the relation alone"


def test_a_speed_at_night_is_no_restriction_to_tell_of() -> None:
    found, left = at_time(extract(maxspeed__conditional="30 @ (22:00-06:00)"), None)
    assert "maxspeed" not in found.ways[1].tags
    assert left == []
    assert at_time(extract(maxspeed__conditional="30 @ (22:00-06:00)"), "23:00")[0].ways[1].tags[
        "maxspeed"
    ] == ("30")
