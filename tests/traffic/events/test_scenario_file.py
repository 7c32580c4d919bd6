"""What people write into a scenario, right and wrong."""

from pathlib import Path

import pytest
import yaml

from urbantwin.errors import InputError
from urbantwin.traffic.events import EVENTS, load_scenario, scenario_events
from urbantwin.traffic.events.places import Place, find_spot
from urbantwin.twin import Twin

PLACE = "place: {x: -30, y: -2}"


def read(tmp_path: Path, twin: Twin, text: str) -> list[dict]:
    path = tmp_path / "scenario.yaml"
    path.write_text(text)
    return load_scenario(path, twin, 60.0)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "events:\n  - event: near_mis\n    at_s: 3",
            "line 2): is 'near_mis'; expected 'near_miss'",
        ),
        ("events:\n  - at_s: 3", "events[0].event (line 2): is missing; expected one of near_miss"),
        (f"events:\n  - event: u_turn\n    at_s: 3\n    {PLACE}\n    spead: 3", "(line 5)"),
        (f"events:\n  - event: u_turn\n    at_s: -3\n    {PLACE}", "at least 0"),
        (f"events:\n  - event: u_turn\n    at_s: 300\n    {PLACE}", "less than 60 s, the motion"),
        (
            "events:\n  - event: u_turn\n    at_s: 3\n    place: {lane: nowhere_1}",
            "events[0].place.lane (line 4): there is no lane 'nowhere_1'; expected",
        ),
        ("events:\n  - event: u_turn\n    at_s: 3\n    place: {street: A}", "no street 'A'"),
        ("events:\n  - event: u_turn\n    at_s: 3\n    place: {x: 3}", "has one coordinate"),
        ("events:\n  - event: u_turn\n    at_s: 3\n    place: {}", "does not say one place"),
        (
            "events:\n  - event: u_turn\n    at_s: 3\n    place: {x: 900, y: 900}",
            "no lane for a car within 15 m",
        ),
        (f"events:\n  - event: near_miss\n    at_s: 3\n    {PLACE}", "one of pet_s and ttc_s"),
        ("events: []", "has no events"),
        ("event: u_turn", "is not a field that is known here"),
    ],
)
def test_what_is_wrong_is_told_with_its_line(
    crossing_twin: Twin, tmp_path: Path, text: str, said: str
) -> None:
    with pytest.raises(InputError) as refused:
        read(tmp_path, crossing_twin, text)
    assert said in str(refused.value)
    assert "scenario.yaml" in str(refused.value)


def test_what_was_read_is_read_again(crossing_twin: Twin, tmp_path: Path) -> None:
    path = {"time_s": [3.0, 4.0], "x": [0.0, 5.0], "y": [0.0, 0.0]}
    needed = {"near_miss": {"pet_s": 1.0}, "trajectory": path}
    rows = [
        {"event": name, "at_s": 3.0, "place": {"x": -30.0, "y": -2.0}, **needed.get(name, {})}
        for name in EVENTS
    ]
    for row in rows:
        if row["event"] in ("blocked_sensor", "trajectory"):
            del row["place"]
    told = read(tmp_path, crossing_twin, yaml.safe_dump({"events": rows}))
    assert told == rows
    assert [one.event for one in scenario_events(told)] == list(EVENTS)


def test_a_place_is_the_same_by_metres_and_by_degrees(crossing_twin: Twin) -> None:
    metres = find_spot(Place(x=-40.0, y=-2.0), crossing_twin, "car")
    longitude, latitude = crossing_twin.frame.lonlat_from_site([[-40.0, -2.0]])[0].tolist()
    degrees = find_spot(Place(latitude=latitude, longitude=longitude), crossing_twin, "car")
    assert degrees.lane.id == metres.lane.id
    assert degrees.along_m == pytest.approx(metres.along_m, abs=1e-3)
    lane = find_spot(Place(lane=metres.lane.id, offset_m=metres.along_m), crossing_twin, "car")
    assert lane.xy == pytest.approx(metres.xy, abs=1e-6)
