"""The lane model as the one source: SUMO's lanes, the strips and OpenDRIVE are the same lines."""

from xml.etree import ElementTree

import numpy as np
import pytest
import shapely

from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.roads import LaneModel, build_roads
from urbantwin.roads.opendrive import write_opendrive
from urbantwin.site import read_extract

from ..thorough import further


@pytest.fixture(
    scope="module",
    params=["West-Oakland", "perth_stretched_lights", *further("taipei", "neukolln")],
)
def built(request, real_roads, tmp_path_factory):
    place = real_roads(request.param, closed_loop=True)
    return place.built, place.net, place.frame, tmp_path_factory.mktemp(request.param)


def sumo_shapes(net):
    """Lane id -> line, straight from SUMO's file."""
    return {
        lane.get("id"): shapely.LineString(
            [[float(v) for v in p.split(",")] for p in lane.get("shape").split()]
        )
        for edge in ElementTree.parse(net).iter("edge")
        if edge.get("function") not in ("crossing", "walkingarea")
        for lane in edge.iter("lane")
    }


def test_lanes_of_opendrive_lie_where_sumo_drives(built, ruler):
    roads, net, frame, folder = built
    write_opendrive(roads.model, frame, folder / "m.xodr", version="1.8", name="m")
    _, maps = ruler(folder / "m.xodr")
    lines = sumo_shapes(net)
    compared = 0
    for road in roads.model.roads:
        if road.junction >= 0 or len(road.sections) > 1:
            continue
        for lane in road.sections[0].lanes:
            if lane.kind not in ("driving", "bus", "bicycle"):
                continue
            s = np.arange(0.0, road.length, 0.5)
            middle = np.array([maps[str(road.id)].middle(at, lane.id)[:2] for at in s])
            away = shapely.distance(shapely.points(middle), lines[lane.strip])
            assert away.max() < 0.02, (road.id, lane.strip)
            compared += 1
    assert compared > 5


def test_ways_through_junctions_are_sumos_too(built, ruler):
    roads, net, frame, folder = built
    write_opendrive(roads.model, frame, folder / "m.xodr", version="1.8", name="m")
    _, maps = ruler(folder / "m.xodr")
    lines = sumo_shapes(net)
    shared = [s for r in roads.model.roads for s in r.sections[0].lanes[0].strip.split()]
    compared = 0
    for road in roads.model.roads:
        names = road.sections[0].lanes[0].strip.split()
        # A lane that several ways pass over can follow one of them only.
        if road.junction < 0 or not names or any(shared.count(name) > 1 for name in names):
            continue
        way = shapely.LineString(np.vstack([shapely.get_coordinates(lines[n]) for n in names]))
        s = np.linspace(0.0, road.length, 40)
        middle = np.array([maps[str(road.id)].reference(at)[:2] for at in s])
        assert shapely.distance(shapely.points(middle), way).max() < 0.02, road.id
        compared += 1
    assert compared > 5


def test_lanes_of_sumo_meet_end_to_end(built):
    _, net, _, _ = built
    lines = sumo_shapes(net)
    root = ElementTree.parse(net).getroot()
    vias = set()
    for item in root.iter("connection"):
        start = f"{item.get('from')}_{item.get('fromLane')}"
        via = item.get("via")
        if via in lines and start in lines:
            gap = np.subtract(lines[start].coords[-1], lines[via].coords[0])
            assert np.linalg.norm(gap) < 0.1, (start, via)
            vias.add(via)
    assert len(vias) > 10


def test_lengths_of_sumo_are_those_of_its_lines(built):
    _, net, _, _ = built
    lines = sumo_shapes(net)
    for edge in ElementTree.parse(net).iter("edge"):
        lanes = [lane for lane in edge.iter("lane") if lane.get("id") in lines]
        driven = [lane for lane in lanes if lane.get("allow") != "pedestrian"] or lanes
        if lanes:
            mean = np.mean([lines[lane.get("id")].length for lane in driven])
            for lane in lanes:
                assert float(lane.get("length")) == pytest.approx(max(mean, 0.1), abs=0.02)


def test_turns_are_drivable(built):
    """Radii of turns: a car can do 5 m, not less (turning circles of 10 to 12 m are usual)."""
    roads, _, _, _ = built
    radii = []
    for road in roads.model.roads:
        if road.junction >= 0 and road.sections[0].lanes[0].kind != "bicycle":
            s = np.linspace(0.0, road.length, max(20, int(road.length * 4)))
            heading = np.unwrap(road.curve.at(s)[:, 2])
            radii.append(1 / max(np.abs(np.gradient(heading, s)).max(), 1e-6))
    assert np.median(radii) > 5.0
    assert np.quantile(radii, 0.1) > 2.5


def test_the_file_keeps_everything(built):
    roads, _, _, folder = built
    roads.model.save(folder / "a.json")
    LaneModel.load(folder / "a.json").save(folder / "b.json")
    assert (folder / "a.json").read_bytes() == (folder / "b.json").read_bytes()


def test_both_directions_of_an_undivided_street_share_a_road(write_osm, tmp_path):
    path = write_osm(
        {1: (-150, 0, {}), 2: (0, 0, {}), 3: (150, 0, {}), 4: (0, 150, {})},
        {
            1: ([1, 2, 3], {"highway": "residential", "name": "A"}),
            2: ([2, 4], {"highway": "residential", "name": "B"}),
        },
    )
    model = build_roads(
        read_extract(path),
        SiteFrame(48.7, 9.18),
        shapely.Point(0, 0).buffer(120),
        Elevation.flat(),
        driving_side="right",
        out=tmp_path / "n.net.xml",
    ).model
    streets = [road for road in model.roads if road.junction < 0]
    assert len(streets) == 3
    for road in streets:
        directions = {lane.forward for lane in road.sections[0].lanes if lane.kind == "driving"}
        assert directions == {True, False}
        for lane in road.sections[0].lanes:
            assert lane.forward == (lane.id < 0)
