"""Lane models made by hand, written, and read back by the standard's formulas."""

import dataclasses
import math
from collections import Counter

import numpy as np
import pytest

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.roads.model import LaneModel, Profile
from urbantwin.roads.opendrive import read_opendrive, write_opendrive
from urbantwin.roads.opendrive.writing.write import as_right_hand_traffic

HERE = SiteFrame(48.7, 9.18)
FORMS = [("right", "1.8"), ("right", "1.4"), ("left", "1.8"), ("left", "1.4")]


@pytest.fixture(params=FORMS, ids="-".join)
def written(request, town, tmp_path, ruler):
    side, version = request.param
    model = town(side)
    write_opendrive(model, HERE, tmp_path / "town.xodr", version=version, name="town")
    return model, version, *ruler(tmp_path / "town.xodr")


def model_borders(model):
    """Every lane border of a model, in space: kind -> list of (K, 3) lines along the road."""
    found = []
    for road in model.roads:
        for section, end in zip(road.sections, road.section_ends, strict=True):
            s = np.linspace(section.s + 1e-3, end - 1e-3, 7)
            for lane in section.lanes:
                lines = [
                    road.place(s, road.border(section, lane, s, outer=outer))
                    for outer in (False, True)
                ]
                found.append((lane.kind, lines))
    return found


def file_borders(roads):
    found = []
    for road in roads.values():
        for k, (start, end) in enumerate(zip(road.starts, road.ends, strict=True)):
            for identity, lane in road.lanes_of(k).items():
                if identity:
                    note = {e.get("code"): e.get("value") for e in lane.findall("userData")}
                    s = np.linspace(start + 1e-3, end - 1e-3, 7)
                    pairs = [road.borders(at, identity, k) for at in s]
                    lines = [np.array([pair[side] for pair in pairs]) for side in (0, 1)]
                    found.append((note.get("kind", lane.get("type")), lines))
    return found


def test_every_lane_border_is_where_the_model_has_it(written):
    model, version, _, roads = written
    word = {"bicycle": "biking"}
    expected, found = model_borders(model), file_borders(roads)
    carriers = len(found) - len(expected)
    assert (carriers > 0) == ((model.driving_side, version) == ("left", "1.4"))
    used = set()
    for kind, lines in expected:
        best = min(
            (
                (max(np.abs(a - b).max() for a, b in zip(order, lines, strict=True)), k)
                for k, (other, theirs) in enumerate(found)
                if other == word.get(kind, kind)
                for order in (theirs, theirs[::-1])
            ),
        )
        assert best[0] < 1e-3, kind
        used.add(best[1])
    assert len(used) == len(expected)


def test_traffic_keeps_to_its_side_along_the_reference_line(written):
    model, version, root, roads = written
    if version == "1.8":
        rule = "LHT" if model.driving_side == "left" else "RHT"
        assert {road.element.get("rule") for road in roads.values()} == {rule}
        return
    assert root.find("header").get("revMinor") == "4"
    for road in roads.values():
        assert road.element.get("rule") is None
    # The west street leads east, to the junction: what drives there has negative ids.
    middles = [
        road.middle(49.0, lane, len(road.sections) - 1)
        for road in roads.values()
        if road.element.get("name") == "High Street"
        for lane, item in road.lanes_of(len(road.sections) - 1).items()
        if lane < 0 and item.get("type") == "driving"
    ]
    expected = -1 if model.driving_side == "right" else 1
    assert {math.copysign(1, y) for _, y, _ in middles} == {expected}


def test_lanes_go_on_where_they_say_they_do(written):
    """Linked lanes meet in space, and each says so of the other."""
    *_, roads = written
    checked = 0
    for road in roads.values():
        for k in range(len(road.sections) - 1):
            before, after = road.lanes_of(k), road.lanes_of(k + 1)
            s = road.ends[k]
            for lane, item in before.items():
                link = item.find("link/successor")
                if link is None:
                    continue
                other = int(link.get("id"))
                assert after[other].find("link/predecessor").get("id") == str(lane)
                gap = np.abs(road.middle(s, lane, k) - road.middle(s, other, k + 1)).max()
                assert gap < 1e-6
                checked += 1
    assert checked == 7


def test_ways_through_the_junction_meet_the_lanes_that_they_join(written):
    model, _, root, roads = written
    links = 0
    for connection in root.findall("junction/connection"):
        way, street = (roads[connection.get(k)] for k in ("connectingRoad", "incomingRoad"))
        assert way.junction == "90"
        for link in connection.findall("laneLink"):
            at = 0.0 if connection.get("contactPoint") == "start" else way.length
            tag = "predecessor" if at == 0 else "successor"
            joined = way.element.find(f"link/{tag}")
            assert joined.get("elementId") == street.id
            last = joined.get("contactPoint") == "end"
            k, s = (len(street.sections) - 1, street.length) if last else (0, 0.0)
            mine = way.middle(at, int(link.get("to")))
            theirs = street.middle(s, int(link.get("from")), k)
            # The plane of a curved cross fall is met to its sagitta.
            assert np.linalg.norm(mine - theirs) < 0.01
            lane = way.lanes_of(0)[int(link.get("to"))]
            assert lane.find(f"link/{tag}").get("id") == link.get("from")
            links += 1
    assert links == sum(len(c.links) for j in model.junctions for c in j.connections)


def test_areas_and_signals_keep_their_place(written):
    model, version, root, roads = written

    def places(area, pose, z):
        x, y, heading = pose
        c, sn = math.cos(heading), math.sin(heading)
        u, v, up = np.array(area).T
        return np.column_stack([x + u * c - v * sn, y + u * sn + v * c, z + up])

    found = {}
    for road in roads.values():
        for item in road.element.iterfind("objects/object"):
            s = float(item.get("s"))
            corners = [[float(c.get(k)) for k in "uvz"] for c in item.iter("cornerLocal")]
            assert corners[0] == corners[-1]
            found[int(item.get("id"))] = places(
                corners[:-1], road.reference(s), road.place(s, 0.0)[2]
            )
    for area in model.areas:
        road = model.road_by_id[area.road]
        z = float(road.elevation.at(area.s)[0])
        assert found[area.id] == pytest.approx(
            places(area.corners, road.curve.at(area.s)[0], z), abs=1e-6
        )
    heads = {
        int(item.get("id")): (road.place(float(item.get("s")), float(item.get("t"))), item)
        for road in roads.values()
        for item in road.element.iterfind("signals/signal")
    }
    for signal in model.signals:
        place, item = heads[signal.id]
        road = model.road_by_id[signal.road]
        lower = road.place(signal.s, signal.t)[0] + [0, 0, signal.z - signal.height / 2]
        assert place + [0, 0, float(item.get("zOffset"))] == pytest.approx(lower, abs=1e-4)
        assert item.get("dynamic") == ("yes" if signal.dynamic else "no")
    assert (
        heads[204][1].attrib.items()
        >= {"country": "DE", "type": "274", "value": "50", "unit": "km/h"}.items()
    )
    controller = root.find("controller")
    together = [[c.get("signalId") for c in e] for e in root.iterfind("controller")]
    together = [[one for one in stage if one] for stage in together]
    # CARLA lights the signals of one controller at a time: 203 is green when 201 and 202 are red.
    assert together == ([["201", "202"], ["203"]] if version == "1.4" else [["201", "202", "203"]])
    notes = {e.get("code"): e.get("value") for e in controller.findall("userData")}
    assert notes == {"phases": "20 GGGr, 3 yyyr, 12.5 rrrG", "offset": "4"}
    named = [one.get("id") for one in root.iterfind("junction/controller")]
    assert named == [one.get("id") for one in root.iterfind("controller")]


def test_kinds_speeds_access_and_heights_are_written(written):
    _, version, _, roads = written
    lanes = [
        lane
        for road in roads.values()
        for k in range(len(road.sections))
        for lane in road.lanes_of(k).values()
    ]
    types = Counter(lane.get("type") for lane in lanes)
    assert {"driving", "biking", "parking", "shoulder", "sidewalk", "median"} <= set(types)
    assert ("curb" in types, "bus" in types) == (version == "1.8", version == "1.8")
    for lane in lanes:
        if lane.get("type") == "sidewalk":
            assert lane.find("height").attrib == {"sOffset": "0", "inner": "0.15", "outer": "0.15"}
        if lane.get("type") == "driving":
            assert float(lane.find("speed").get("max")) in (13.89, 8.33)
        if lane.get("type") == "bus":
            allowed = [e.get("type") for e in lane.iterfind("access/restriction")]
            assert (lane.find("access").get("rule"), allowed) == ("allow", ["bus", "bicycle"])
    for road in roads.values():
        for item in road.element.iterfind("type/speed"):
            assert item.get("max").isdigit()


@pytest.mark.parametrize("version", ["1.8", "1.4"])
def test_lanes_that_are_closed_to_everybody_are_restricted(town, tmp_path, ruler, version):
    """ASAM OpenDRIVE 1.8, 11.7.1: "restricted", a lane on which cars should not drive."""
    model = town("right")
    number = next(k for k, road in enumerate(model.roads) if road.junction < 0)
    road = model.roads[number]
    sections = tuple(
        dataclasses.replace(
            section,
            lanes=tuple(
                dataclasses.replace(lane, allowed=()) if lane.kind == "driving" else lane
                for lane in section.lanes
            ),
        )
        for section in road.sections
    )
    closed = dataclasses.replace(road, sections=sections)
    roads = (*model.roads[:number], closed, *model.roads[number + 1 :])
    path = tmp_path / "closed.xodr"
    write_opendrive(dataclasses.replace(model, roads=roads), HERE, path, version=version, name="x")
    _, found = ruler(path)
    items = [
        lane
        for k in range(len(found[str(road.id)].sections))
        for lane in found[str(road.id)].lanes_of(k).values()
    ]
    assert "driving" not in {item.get("type") for item in items}
    shut = [item for item in items if item.get("type") == "restricted"]
    assert len(shut) == sum(x.kind == "driving" for part in road.sections for x in part.lanes) > 0
    for item in shut if version == "1.8" else ():
        assert item.find("access").get("rule") == "deny"
        denied = {e.get("type") for e in item.iterfind("access/restriction")}
        assert {"passengerCar", "truck", "bus", "motorcycle"} <= denied
    if version == "1.8":
        again = next(x for x in read_opendrive(path).model.roads if x.id == road.id)
        users = {x.allowed for part in again.sections for x in part.lanes if x.kind == "driving"}
        assert users == {()}


def test_right_hand_form_leaves_right_hand_traffic_alone(town):
    model = town("right")
    assert as_right_hand_traffic(model) is model


def test_a_one_way_street_stays_one_road(town):
    """With its sidewalks on both sides, although those have ids of both signs."""
    model = town("left")
    street = model.roads[0]
    section = street.sections[-1]
    lanes = tuple(
        dataclasses.replace(lane, kind="sidewalk" if lane.id == -1 else lane.kind)
        for lane in section.lanes
        if lane.id >= -1
    )
    alone = dataclasses.replace(
        street, sections=(dataclasses.replace(section, s=0.0, lanes=lanes),), successor=None
    )
    result = as_right_hand_traffic(LaneModel("left", (alone,)))
    (road,) = result.roads
    assert [lane.id for lane in road.sections[0].lanes] == [-1, -2, -3, -4, -5, -6]
    kinds = [lane.kind for lane in road.sections[0].lanes]
    assert kinds == ["sidewalk", "curb", "driving", "bicycle", "driving", "sidewalk"]
    assert road.offset.at(30.0) == pytest.approx(3.25 + 1.5 + 3.0 + 0.2 + 2.0)


def test_redundant_records_are_left_out_and_nothing_moves(town, tmp_path, ruler):
    model = town("right")
    street = model.roads[1]
    knots = np.array([0.0, 7.0, 20.0, 33.0])
    about = np.column_stack([5 + 0.02 * knots, np.full(4, 0.02), np.zeros(4), np.zeros(4)])
    about[3, 2] = 1e-4
    street = dataclasses.replace(street, elevation=Profile(knots, about), predecessor=None)
    write_opendrive(LaneModel("right", (street,)), HERE, tmp_path / "a.xodr", name="a")
    _, roads = ruler(tmp_path / "a.xodr")
    assert len(roads["2"].element.findall("elevationProfile/elevation")) == 2
    for s in np.linspace(0, street.length, 60):
        expected = street.place(s, 2.0)[0]
        assert roads["2"].place(s, 2.0) == pytest.approx(expected, abs=1e-6)


def test_names_that_xml_cannot_hold_lose_what_it_cannot(town, tmp_path, ruler):
    model = town("right")
    street = dataclasses.replace(
        model.roads[0], name="A\x0b & <B>\ud800 \u5357\u4eac", successor=None
    )
    write_opendrive(LaneModel("right", (street,)), HERE, tmp_path / "a.xodr", name="\x00x")
    root, _ = ruler(tmp_path / "a.xodr")
    assert root.find("road").get("name") == "A & <B> \u5357\u4eac"


def test_the_same_model_gives_the_same_bytes(town, tmp_path):
    for name in ("a.xodr", "b.xodr"):
        write_opendrive(town("left"), HERE, tmp_path / name, version="1.4", name="x")
    assert (tmp_path / "a.xodr").read_bytes() == (tmp_path / "b.xodr").read_bytes()


@pytest.mark.parametrize("version", ["1.6", "", "2"])
def test_an_unknown_version_is_refused(town, tmp_path, version):
    with pytest.raises(InputError, match=r"one of 1\.8, 1\.4"):
        write_opendrive(town(), HERE, tmp_path / "a.xodr", version=version, name="x")
    assert not list(tmp_path.iterdir())


def test_a_model_without_roads_is_refused(tmp_path):
    with pytest.raises(InputError, match="no roads"):
        write_opendrive(LaneModel("right", ()), HERE, tmp_path / "a.xodr", name="x")
    assert not list(tmp_path.iterdir())
