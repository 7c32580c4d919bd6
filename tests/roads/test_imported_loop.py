"""The closed loop of a map: whoever drives out comes back, by SUMO's own reckoning."""

import dataclasses
import math
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely
import sumolib

from urbantwin.geometry import SiteFrame
from urbantwin.roads.imported import ImportedMap, build_imported_roads, prepared_map
from urbantwin.roads.netconvert import sumo_binary, sumo_environment

from .tee import EAST, FAR, MOUTH, SOUTH, WEST, tee

FRAME = SiteFrame(50.0, 8.0)
REGION = shapely.Point(0.0, 0.0).buffer(90.0)


def built(model, folder, region=REGION):
    prepared = prepared_map(ImportedMap(Path("m.xodr"), model), region, None, closed_loop=True)
    roads = build_imported_roads(prepared, FRAME, out=folder / "n.net.xml")
    return roads, sumolib.net.readNet(str(folder / "n.net.xml"), withInternal=True)


@pytest.fixture(scope="module", params=["right", "left"])
def closed(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("loop")
    return (*built(tee(request.param, slope=(0.02, 0.01)), folder), folder)


def test_every_edge_leads_on_and_is_led_to(closed):
    roads, net, _ = closed
    assert roads.notes["closed_loop"]["turning_drops"] == 3
    assert roads.notes["closed_loop"]["open_ends"] == 0
    streets = [edge for edge in net.getEdges(withInternal=False) if edge.allows("passenger")]
    for edge in streets:
        assert [e for e in edge.getOutgoing() if e.allows("passenger")], edge.getID()
        assert [e for e in edge.getIncoming() if e.allows("passenger")], edge.getID()


def test_outer_roads_lie_beyond_the_border_and_are_not_the_maps(closed):
    roads, _, _ = closed
    outer = [road for road in roads.network.roads if not road.ways]
    assert outer
    assert {way for road in roads.network.roads for way in road.ways} == {WEST, EAST, SOUTH}
    for road in outer:
        for name in road.lanes:
            lane = roads.network.lane_by_id[name]
            assert (np.linalg.norm(lane.centre[:, :2], axis=1) > 85.0).all()


def test_a_bus_gets_round_and_the_way_has_no_step(closed):
    """A 12 m bus needs an inner radius of 5.3 m (Directive 97/27/EC); lanes go on in height too."""
    roads, _, _ = closed
    lanes = roads.network.lane_by_id
    outer = {name for road in roads.network.roads if not road.ways for name in road.lanes}
    for name in outer:
        xy = lanes[name].centre[:, :2]
        leg = np.diff(xy, axis=0)
        step = np.linalg.norm(leg, axis=1)
        turn = np.abs(np.diff(np.unwrap(np.arctan2(leg[:, 1], leg[:, 0]))))
        radius = (step[1:] + step[:-1]) / 2 / np.maximum(turn, 1e-9)
        assert radius[turn > 1e-3].min(initial=99.0) > 5.3 + 1.25
        for following in lanes[name].successors:
            gap = lanes[following].centre[0] - lanes[name].centre[-1]
            assert np.abs(gap[:2]).max() < 0.06, (name, following)
            assert abs(gap[2]) < 0.01, (name, following)


def test_vehicles_drive_round_for_ten_minutes(closed, tmp_path):
    """Twelve cars, each told to drive every approach over and over; nobody is moved by hand."""
    _, net, folder = closed
    rng = np.random.default_rng(3)
    edges = {e.getID(): e for e in net.getEdges(withInternal=False) if e.allows("passenger")}
    rows = ""
    for number, name in enumerate(list(edges)[:12]):
        way, at = [name], edges[name]
        for _ in range(400):
            choices = sorted(
                (e for e in at.getOutgoing() if e.allows("passenger")), key=lambda e: e.getID()
            )
            at = choices[rng.integers(len(choices))]
            way.append(at.getID())
        rows += (
            f'<vehicle id="{number}" depart="{number * 3}"><route edges="{" ".join(way)}"/>'
            "</vehicle>"
        )
    (tmp_path / "r.rou.xml").write_text(f"<routes>{rows}</routes>")
    report = tmp_path / "s.xml"
    done = subprocess.run(
        [str(sumo_binary("sumo")), "-n", str(folder / "n.net.xml"), "-r",
         str(tmp_path / "r.rou.xml"), "-e", "600", "--statistic-output", str(report),
         "--collision.check-junctions", "--collision.action", "warn", "--no-step-log",
         "--time-to-teleport", "120"],
        capture_output=True, text=True, check=False, env=sumo_environment(),
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    root = ElementTree.parse(report).getroot()
    assert root.find("teleports").get("total") == "0"
    assert root.find("safety").get("collisions") == "0", done.stderr
    assert root.find("vehicles").get("inserted") == "12"
    assert root.find("vehicles").get("running") == "12"


def test_two_carriageways_lead_into_each_other(tmp_path):
    """A street of two one-way roads: its exit leads to its entry, and nothing turns in place."""
    model = tee(crosswalk=False)
    east = model.road_by_id[EAST]
    out, back = (
        dataclasses.replace(
            east,
            id=number,
            sections=tuple(
                dataclasses.replace(
                    part, lanes=tuple(x for x in part.lanes if x.id * sign < 0 or abs(x.id) > 9)
                )
                for part in east.sections
            ),
        )
        for number, sign in ((EAST, 1), (60, -1))
    )
    fixed = [
        dataclasses.replace(road, predecessor=dataclasses.replace(road.predecessor, id=60))
        if road.junction >= 0 and road.predecessor.id == EAST
        else road
        for road in model.roads
        if road.id != EAST
    ]
    junction = dataclasses.replace(
        model.junctions[0],
        connections=tuple(
            dataclasses.replace(c, incoming=60) if c.incoming == EAST else c
            for c in model.junctions[0].connections
        ),
    )
    model = dataclasses.replace(model, roads=(*fixed, out, back), junctions=(junction,))
    roads, net = built(model, tmp_path)
    assert roads.notes["closed_loop"]["carriageways_joined"] == 1
    assert roads.notes["closed_loop"]["turning_drops"] == 2
    (onward,) = [e for e in net.getEdge(f"{EAST}").getOutgoing() if e.allows("passenger")]
    (back_in,) = [e for e in onward.getOutgoing() if e.allows("passenger")]
    assert back_in.getID() == "-60"
    # Both sides say so, as OpenDRIVE wants it.
    out, back = (roads.model.road_by_id[number] for number in (EAST, 60))
    outer = roads.model.road_by_id[out.successor.id]
    assert (outer.predecessor.id, outer.successor.id, back.successor.id) == (EAST, 60, outer.id)
    assert out.sections[-1].by_id[-1].successor == outer.sections[0].lanes[0].id
    assert back.sections[-1].by_id[1].successor == outer.sections[0].lanes[0].id


def test_what_cannot_be_closed_is_counted(tmp_path):
    """One way out and none in: there is nowhere to lead it."""
    model = tee(crosswalk=False)
    east = model.road_by_id[EAST]
    alone = dataclasses.replace(
        east,
        predecessor=None,
        sections=tuple(
            dataclasses.replace(part, lanes=tuple(x for x in part.lanes if x.id < 0))
            for part in east.sections
        ),
    )
    model = dataclasses.replace(model, roads=(alone,), junctions=(), areas=())
    roads, _ = built(model, tmp_path, shapely.box(MOUTH - 50, -50, FAR + 50, 50))
    # Its own end leads round to its own start.
    assert roads.notes["closed_loop"]["roads_round_the_region"] == 1
    assert roads.notes["closed_loop"]["open_ends"] == 0
    outer = [road for road in roads.network.roads if not road.ways]
    length = sum(roads.network.lane_by_id[road.lanes[0]].length for road in outer)
    assert length > 2 * (FAR - MOUTH) / math.pi
