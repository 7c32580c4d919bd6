"""Controllers as CARLA takes them: one at a time is green, and all of its signals are."""

import math
from dataclasses import replace
from itertools import combinations

import pytest
from lxml import etree

from urbantwin.geometry import SiteFrame
from urbantwin.roads.model import RoadSignal, SignalController
from urbantwin.roads.opendrive import write_opendrive
from urbantwin.roads.opendrive.writing.write import _stages


def head(number, *links, road=1, kind="1000001"):
    lanes = (-1,) if kind == "1000001" else ()
    place = {"s": 0.0, "t": 0.0, "z": 3.0, "orientation": "+", "lanes": lanes}
    kinds = {"country": "OpenDRIVE", "type": kind, "subtype": "-1", "value": math.nan, "unit": ""}
    return RoadSignal(number, road, "", True, **kinds, **place, program="p", links=links)


def stages(phases, *heads):
    return _stages(SignalController(9, "p", (), (), 0.0, tuple(phases)), heads)


def test_approaches_that_are_green_in_turn_are_stages_in_that_turn():
    north, south, east = head(1, 0), head(2, 1), head(3, 2, road=2)
    found = stages([(5, "rrG"), (3, "rry"), (20, "GGr"), (3, "yyr")], north, south, east)
    assert found == [{3}, {1, 2}]


def test_signals_that_are_never_green_together_are_in_no_stage_together():
    """Through and left of both directions, with a phase of either direction alone."""
    heads = [head(k + 1, k) for k in range(4)]  # through and left of one, of the other
    found = stages([(8, "GGrr"), (20, "GrGr"), (8, "rrGG")], *heads)
    assert sorted(one for stage in found for one in stage) == [1, 2, 3, 4]
    for stage in found:
        assert stage not in ({1, 4}, {2, 3}, {2, 4})
        assert not any({1, 4} <= stage or {2, 3} <= stage or {2, 4} <= stage for stage in found)


def test_a_lane_of_several_ways_shows_what_its_main_way_shows():
    """A turn is green for longer: its lane is green where all of its ways are."""
    found = stages([(4, "rGG"), (20, "GGr"), (20, "rrG")], head(1, 0, 1), head(2, 2))
    assert found == [{2}, {1}]


def test_heads_for_people_go_with_vehicles_where_they_may():
    along = head(10, 2, kind="1000002")
    alone = head(11, 3, kind="1000002")
    found = stages([(20, "GrGr"), (20, "rGrr"), (9, "rrrG")], head(1, 0), head(2, 1), along, alone)
    assert found == [{1, 10}, {2}, {11}]


def test_without_a_program_roads_take_turns():
    found = stages([], head(1, road=4), head(2, road=4), head(3, road=5))
    assert found == [{1, 2}, {3}]
    assert stages([(10, "r")], head(1, 0)) == [{1}]
    assert stages([(10, "G")]) == []


def test_no_two_signals_of_a_stage_are_green_at_different_times_alone(two_avenues_twin, tmp_path):
    """In the file, as `Import.py` hands it to CARLA."""
    twin = two_avenues_twin
    write_opendrive(twin.lane_model, twin.frame, tmp_path / "m.xodr", version="1.4", name="m")
    root = etree.parse(tmp_path / "m.xodr").getroot()
    together = [
        {int(c.get("signalId")) for c in e.iter("control")} for e in root.iter("controller")
    ]
    together = [stage for stage in together if stage]
    assert len(together) >= 2
    known = {signal.id: signal for signal in twin.lane_model.signals if signal.dynamic}
    assert sorted(one for stage in together for one in stage) == sorted(known)
    (program,) = twin.lane_model.controllers
    for stage in together:
        for one, other in combinations(sorted(stage), 2):
            a, b = known[one].links, known[other].links
            assert any(
                any(state[k] in "Gg" for k in a) and any(state[k] in "Gg" for k in b)
                for _, state in program.phases
            ), (one, other)
    for item in root.iter("signal"):
        validity = [(v.get("fromLane"), v.get("toLane")) for v in item.findall("validity")]
        assert validity, item.get("id")
        if item.get("type") == "1000002":
            assert validity == [("0", "0")]


@pytest.mark.parametrize(
    ("orientation", "lanes"), [("+", {-3, -2, -1}), ("-", {1, 2}), ("none", {-3, -2, -1, 1, 2})]
)
def test_signals_without_lanes_get_those_of_their_direction(
    two_avenues_twin, tmp_path, orientation, lanes
):
    """CARLA would take those of the other."""
    twin = two_avenues_twin
    model = twin.lane_model
    road = next(
        r for r in model.roads
        if r.junction < 0
        and {x.id for x in r.sections[0].lanes if x.kind == "driving"} == {-2, -1, 1}
    )  # fmt: skip
    sign = replace(
        next(s for s in model.signals if not s.dynamic),
        road=road.id, s=0.5, lanes=(), orientation=orientation, id=model.next_id,
    )  # fmt: skip
    model = replace(model, signals=(*model.signals, sign))
    write_opendrive(model, SiteFrame(48.7, 9.18), tmp_path / "m.xodr", version="1.4", name="m")
    root = etree.parse(tmp_path / "m.xodr").getroot()
    (item,) = [one for one in root.iter("signal") if one.get("id") == str(sign.id)]
    found = set()
    for one in item.findall("validity"):
        found |= set(range(int(one.get("fromLane")), int(one.get("toLane")) + 1))
    assert found - {0} == lanes


@pytest.mark.parametrize(
    ("value", "unit", "plate", "km_h"),
    [(50, "km/h", "50", 50), (20, "km/h", "30", 20), (30, "mph", "50", 48)],
)
def test_a_speed_limit_has_a_plate_of_carlas(two_avenues_twin, tmp_path, value, unit, plate, km_h):
    twin = two_avenues_twin
    model = twin.lane_model
    sign = next(s for s in model.signals if not s.dynamic)
    others = [s for s in model.signals if s is not sign]
    model = replace(model, signals=(*others, replace(sign, value=float(value), unit=unit)))
    write_opendrive(model, twin.frame, tmp_path / "m.xodr", version="1.4", name="m")
    root = etree.parse(tmp_path / "m.xodr").getroot()
    (item,) = [one for one in root.iter("signal") if one.get("id") == str(sign.id)]
    assert (item.get("type"), item.get("subtype"), item.get("unit")) == ("274", plate, "km/h")
    assert float(item.get("value")) == km_h


def test_a_light_before_its_stop_line_stops_vehicles_at_the_line(two_avenues_twin, tmp_path):
    twin = two_avenues_twin
    model = twin.lane_model
    line = next(a for a in model.areas if a.name == "StopLine")
    light = next(s for s in model.signals if s.road == line.road and s.type == "1000001")
    others = [s for s in model.signals if s is not light]
    model = replace(model, signals=(*others, replace(light, s=line.s - 4.0)))
    write_opendrive(model, twin.frame, tmp_path / "m.xodr", version="1.4", name="m")
    root = etree.parse(tmp_path / "m.xodr").getroot()
    (stands,) = [e for e in root.iter("signal") if e.get("id") == str(light.id)]
    (holds,) = [e for e in root.iter("signalReference") if e.get("id") == str(light.id)]
    assert float(stands.get("s")) == pytest.approx(line.s - 4.0)
    assert [one.get("fromLane") for one in stands.findall("validity")] == ["0"]
    assert float(holds.get("s")) == pytest.approx(line.s)
    assert {int(one.get("fromLane")) for one in holds.findall("validity")} == {min(light.lanes)}
