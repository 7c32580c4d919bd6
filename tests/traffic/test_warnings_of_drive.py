"""What a motion warns of."""

from typing import Any

from urbantwin.result_warning import rows_of
from urbantwin.traffic.result_warnings import warnings_of_drive


def motion(**changed: Any) -> dict[str, Any]:
    circulation = {
        "carried_share_of_motor_traffic": 1.0,
        "halted": [],
        "halted_longer_than_s": 300.0,
        **changed.pop("circulation", {}),
    }
    told = {
        "left_out": [],
        "classes": {"car": {"asked": 10, "driven": 10}},
        "teleports": 0,
        "collisions": 0,
        "poses_outside_ground": 0,
        "circulation": circulation,
    }
    return {**told, **changed}


def problems(**changed: Any) -> list[str]:
    return [str(one) for one in warnings_of_drive(motion(**changed))]


def test_traffic_as_asked_for_has_no_warning() -> None:
    assert problems() == []
    assert problems(circulation={"carried_share_of_motor_traffic": 0.9}) == []


def test_what_is_not_carried_left_out_or_stuck_is_told_with_its_number() -> None:
    (line,) = problems(circulation={"share_of_guess": 0.6})
    assert "60% of the guessed motor traffic" in line
    (line,) = problems(circulation={"carried_share_of_motor_traffic": 0.41})
    assert "41 %" in line.replace("41%", "41 %")
    assert "traffic.per_hour" in line
    out = [{"class": "pedestrian", "count": 7, "why": "no room on the footways"}]
    (line,) = problems(left_out=out)
    assert line == "traffic pedestrian: 7 are left out: no room on the footways"
    (line,) = problems(classes={"bus": {"asked": 5, "driven": 2}})
    assert "3 of 5 never came in" in line
    (line,) = problems(circulation={"halted": [{"lane": "b_0"}, {"lane": "a_0"}, {"lane": "a_0"}]})
    assert "3 actors" in line
    assert "a_0, b_0" in line
    absent = {"visits": 3, "of": 100, "actors": {"bus": 1, "pedestrian": 2}}
    (line,) = problems(absent=absent)
    assert "3 of 100 visits are left out: 1 bus, 2 pedestrian would pass" in line
    assert problems(absent={**absent, "visits": 2}) == []
    told = {"with": {"pedestrian and pole": 2}, "most_at": {"x": 8.4, "y": -7.0, "visits": 2}}
    (line,) = problems(absent={**absent, **told})
    assert "2 of them near 8.4, -7; most often pedestrian and pole" in line
    assert len(problems(teleports=1, collisions=2, poses_outside_ground=3)) == 3
    seen = {"who": ["car-a", "bus-b"], "time_s": 7.5, "x": 1.0, "y": -2.5, "lane": "a_0"}
    (line,) = problems(collisions=1, collided=[seen])
    assert "collisions: SUMO counted 1: car-a and bus-b at 1, -2.5, 7.5 s" in line


def test_who_is_left_out_is_not_told_again_as_late() -> None:
    out = [{"class": "bus", "count": 3, "why": "no way through the region"}]
    rows = rows_of(
        warnings_of_drive(motion(left_out=out, classes={"bus": {"asked": 5, "driven": 2}}))
    )
    assert [row["problem"] for row in rows] == ["3 are left out"]


def test_where_traffic_is_held_up_is_the_reason() -> None:
    told = {"carried_share_of_motor_traffic": 0.5, "held_up": "the queue on High Street begins"}
    (line,) = problems(circulation=told)
    assert "High Street" in line


def test_an_event_that_is_elsewhere_or_touches_somebody_is_told() -> None:
    near = {"track": 7, "gap_m": 0.4, "gap_at_s": 12.0}
    there = {"event": "hard_brake", "nearest": near}
    assert problems(events=[there]) == []
    (line,) = problems(events=[{**there, "moved_m": 35.8, "moved_because": "a queue"}])
    assert "is 36 m from the requested place: a queue" in line
    assert "within_m: 0" in line
    (line,) = problems(events=[{**there, "nearest": {**near, "gap_m": 0.0}}])
    assert "touches track 7 at 12 s" in line
    assert problems(events=[{"event": "collision", "nearest": {**near, "gap_m": 0.0}}]) == []


def test_more_traffic_than_asked_for_is_told_beyond_chance() -> None:
    told = {
        "counted_for_s": 33,
        "passages_per_hour": {"car": {"asked": 2147.0}},
        "motor_traffic_per_hour": {"asked": 2147.0, "driven": 4691.0},
    }
    (line,) = problems(circulation={**told, "carried_share_of_motor_traffic": 2.185})
    assert "4691 motor vehicles an hour drive, of 2147 requested" in line
    assert problems(circulation={**told, "carried_share_of_motor_traffic": 1.6}) == []


def test_too_few_expected_vehicles_say_nothing_about_the_share_driven() -> None:
    """151 an hour are 1.4 in 33 s: none comes in one of four such motions (e^-1.4)."""
    few = {"counted_for_s": 33, "carried_share_of_motor_traffic": 0.0}
    assert problems(circulation={**few, "passages_per_hour": {"car": {"asked": 151.0}}}) == []
    (line,) = problems(circulation={**few, "passages_per_hour": {"car": {"asked": 500.0}}})
    assert "0% of the requested motor traffic is driven" in line


def test_a_junction_without_traffic_is_the_first_warning() -> None:
    seen = {"within_m": 50.0, "lanes_m": 700.0, "lanes_without_demand_m": 0.0}
    classes = {"car": {"asked": 10, "driven": 10, "per_hour": 2560.0}}
    wrong = {"classes": classes, "duration_s": 30.0, "teleports": 1}

    def first(**there: float) -> str:
        lines = problems(**wrong, past_sensors={**seen, **there})
        return lines[0] if len(lines) > 1 else ""

    line = first(asked_per_hour=0.0, driven_per_hour=0.0, vehicles=0)
    assert line.startswith("traffic past the sensors: none of 2560 motor vehicles an hour")
    line = first(asked_per_hour=900.0, driven_per_hour=0.0, vehicles=0)
    assert "no motor vehicle comes within 50 m of a sensor, of 900 an hour planned" in line
    absent = {"visits": 20, "of": 89, "actors": {"car": 20}}
    (line, *_) = problems(
        **wrong, absent=absent,
        past_sensors={**seen, "asked_per_hour": 900.0, "driven_per_hour": 450.0, "vehicles": 4},
    )  # fmt: skip
    assert "450 of 900 motor vehicles an hour drive within 50 m" in line
    assert "20 of 89 visits are left out" in line
    # By chance 25 of 30 s' 7.5 vehicles, or none of one that is expected, say nothing.
    assert first(asked_per_hour=900.0, driven_per_hour=600.0, vehicles=6) == ""
    assert first(asked_per_hour=120.0, driven_per_hour=0.0, vehicles=0) == ""
    # A sensor that watches no lane of motor vehicles misses none.
    assert first(lanes_m=0.0, asked_per_hour=0.0, driven_per_hour=0.0, vehicles=0) == ""
