"""Packages for CARLA as CARLA's own library reads them, and as its import relies on their files.

The rules are those of CARLA 0.9.16's code, named beside each test.
"""

import json
import re
from collections import Counter
from types import SimpleNamespace

import numpy as np
import pytest
import shapely
from lxml import etree

from urbantwin.exports.carla.meshes import navigation_area
from urbantwin.exports.carla.names import OBJECTS, folder_of
from urbantwin.io.fbx import read_fbx
from urbantwin.roads.opendrive.writing.carla import PLATES

#: ``carla/road/SignalType.cpp``: what is a traffic light; signs that stand for themselves.
LIGHTS = {f"10000{k:02d}" for k in (1, 2, *range(7, 21))} | {"F", "W", "A"}
SIGNS = {"205", "206", "274"}
WALKERS = "1000002"
#: No more than that is addressed by RecastBuilder: 128 x 128 tiles of 51.2 m.
LARGEST_M = 6553.0


@pytest.fixture(scope="module", params=["small", pytest.param("perth", marks=pytest.mark.thorough)])
def package(request, judge):
    """The files of a package, and what `carla.Map` makes of its roads."""
    folder = request.getfixturevalue(f"{request.param}_package")
    told = json.loads((folder / "carla.json").read_text())
    name = told["map"]
    base = folder / told["package"] / name / name
    mesh = read_fbx(base.with_suffix(".fbx")).mesh
    pairs = [one.split(" / ") for one in mesh.names]
    spawns = json.loads((folder / "spawn_points.json").read_text())["spawn_points"]
    placed = [{key: one[key] for key in ("location", "rotation")} for one in spawns]
    xodr = base.with_suffix(".xodr")
    return SimpleNamespace(
        name=name,
        folder=folder,
        fbx=base.with_suffix(".fbx"),
        node=[pairs[k][0] for k in mesh.object],
        materials=pairs,
        corners=mesh.vertices[mesh.faces],
        roads=etree.parse(xodr).getroot(),
        carla=judge("carla_package", job={"source": str(xodr), "spawns": placed}),
    )


def test_there_is_a_way_on_and_to_every_road(package):
    """``carla.Map``, and ``cook_in_memory_map`` for the Traffic Manager."""
    answer = package.carla
    assert answer["traffic_manager_bytes"] > 0
    joined = {
        (int(road.get("id")), tag == "successor")
        for road in package.roads.iterfind("road")
        for tag in ("predecessor", "successor")
        if road.find(f"link/{tag}") is not None
    }
    driven = {(road, lane) for road, lane, *_ in answer["waypoints"]}
    assert len(driven) > 10
    assert not [(road, lane) for road, lane, *_ in answer["ends"] if (road, lane < 0) in joined]
    reached = {(road, lane < 0) for _, (road, lane, *_) in answer["topology"]}
    begins = {(road, lane < 0) for road, lane in driven if (road, lane > 0) in joined}
    assert begins <= reached


def test_lanes_of_signals_are_there_and_heads_for_people_stop_nobody(package):
    """``MapBuilder.cpp``."""
    assert package.carla["signals"]
    for one in package.carla["signals"]:
        assert all(one["lanes"].values()), one
        assert one["type"] != WALKERS or not one["driven"], one


def test_signals_are_of_types_that_carla_knows_and_of_their_direction(package):
    """``TrafficLightManager.cpp``."""
    for road in package.roads.iterfind("road"):
        for item in (*road.iterfind("signals/signal"), *road.iterfind("signals/signalReference")):
            if item.tag == "signal":
                assert item.get("type") in LIGHTS | SIGNS
            if item.get("type") == "274":
                assert float(item.get("value")) > 0
                assert item.get("subtype") in map(str, PLATES)
            held = [int(one.get(k)) for one in item.findall("validity")
                    for k in ("fromLane", "toLane")]  # fmt: skip
            assert held  # else CARLA takes those of the other direction
            facing = item.get("orientation")
            assert max(held) <= 0 if facing == "+" else True
            assert min(held) >= 0 if facing == "-" else True


def test_controllers_are_stages_of_a_junction(package):
    """``TrafficLightGroup.cpp``: one controller of a junction is green at a time."""
    lights = {e.get("id") for e in package.roads.iter("signal") if e.get("type") in LIGHTS}
    control = {
        one.get("id"): [c.get("signalId") for c in one.iterfind("control")]
        for one in package.roads.iterfind("controller")
    }
    named = [
        [e.get("id") for e in junction.iterfind("controller")]
        for junction in package.roads.iterfind("junction")
    ]
    assert {one for some in named for one in some} == control.keys()
    counted = Counter(one for some in control.values() for one in some)
    assert counted.keys() == lights
    assert set(counted.values()) <= {1}
    roads = Counter(
        {item.get("id"): road.get("id") for road in package.roads.iterfind("road")
         for item in road.iterfind("signals/signal")}
    )  # fmt: skip
    for some in named:
        if len(some) == 1:
            assert len({roads[name] for name in control[some[0]]}) <= 2  # not all green at once


def test_lights_stop_vehicles_at_the_stop_line(package):
    """``TrafficLightComponent.cpp``."""
    inner = {road.get("id") for road in package.roads.iterfind("road[@junction!='-1']")}
    lines = {
        road.get("id"): [
            float(e.get("s")) for e in road.iterfind("objects/object[@name='StopLine']")
        ]
        for road in package.roads.iterfind("road")
    }
    length = {road.get("id"): float(road.get("length")) for road in package.roads.iterfind("road")}
    stops = [s for s in package.carla["signals"] if s["type"] in LIGHTS and s["driven"]]
    assert stops
    for one in stops:
        road, s = str(one["road"]), one["s"]
        assert road not in inner, one
        if lines[road]:
            assert min(abs(s - line) for line in lines[road]) <= 1.0, one
        else:
            assert min(length[road] - s if lane < 0 else s for lane in one["driven"]) <= 15.0, one


def test_spawn_points_are_on_lanes_in_their_direction(package):
    assert len(package.carla["spawns"]) > 5
    for found in package.carla["spawns"]:
        assert found is not None
        assert not found["junction"]
        assert found["aside"] <= min(found["width"] / 2, 0.5)
        assert abs(found["turned"]) <= 10.0


def test_every_waypoint_is_over_the_carriageway(package):
    """Same frame, same unit, same roads; CARLA knows no cross-fall."""
    points = np.array(package.carla["waypoints"])[:, 3:6] * [1, -1, 1]
    corners = package.corners[[name.startswith("Road_Road_") for name in package.node]]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    level = normal[:, 2] > 1e-6
    corners, normal = corners[level], normal[level]
    tree = shapely.STRtree(shapely.polygons(corners[:, :, :2]))
    place = shapely.points(points[:, :2])
    point, face = tree.query(place, predicate="dwithin", distance=0.05)
    assert len(np.unique(point)) == len(points)
    gap = points[point, :2] - corners[face, 0, :2]
    plane = corners[face, 0, 2] - (gap * normal[face, :2]).sum(axis=1) / normal[face, 2]
    over = np.full(len(points), np.inf)
    np.minimum.at(over, point, np.abs(points[point, 2] - plane))
    assert over.max() < 0.5


def test_meshes_and_materials_are_named_as_the_import_sorts_them(package):
    """``MoveAssetsCommandlet.cpp``, ``PrepareAssetsForCookingCommandlet.cpp``."""
    nodes = list(dict.fromkeys(package.node))
    assert len({name.lower() for name in nodes}) == len(nodes)
    kinds = {name.rsplit("_", 1)[0] for name in nodes}
    assert {"Road_Road", "Road_Marking", "Terrain"} <= kinds <= OBJECTS.keys()
    for name, material in package.materials:
        assert re.fullmatch(r"[A-Za-z0-9_]+", name + material)
        kind = name.rsplit("_", 1)[0]
        own = kind in ("TrafficLight", "TrafficSign")
        assert folder_of(f"{package.name}_{name}") == (None if own else folder_of(f"M_{kind}_0"))
        assert own or not re.search("light|sign", material, re.IGNORECASE)
    road = [one for one in package.materials if one[0].startswith("Road_Road")]
    assert len({name for name, _ in road}) == len(road)  # CARLA replaces the first alone


def test_the_fbx_is_of_a_version_and_a_size_that_carla_takes(package):
    """The FBX SDK of Unreal Engine 4.26 (2020.1) reads FBX 2011 to 2020."""
    header = package.fbx.read_bytes()[:27]
    assert header.startswith(b"Kaydara FBX Binary")
    assert 7100 <= int.from_bytes(header[23:27], "little") <= 7700
    every = package.corners.reshape(-1, 3)
    assert np.ptp(every, axis=0)[:2].max() < LARGEST_M
    assert np.abs(every).max() < 10_000.0


def test_people_walk_on_the_areas_of_the_mesh(package):
    """``FBX2OBJ.cpp`` and ``Navigation.h``: metres, y up, z south, five materials."""
    vertices, faces, areas, name = [], [], [], ""
    for line in (package.folder / "navigation" / f"{package.name}.obj").read_text().splitlines():
        word, _, rest = line.partition(" ")
        if word == "v":
            vertices.append([float(one) for one in rest.split()])
        elif word == "f":
            faces.append([int(one.split("/")[0]) - 1 for one in rest.split()])
            areas.append(name)
        elif word == "usemtl":
            name = rest.strip()
    site = np.array(vertices)[np.array(faces)][:, :, [0, 2, 1]] * [1.0, -1.0, 1.0]
    assert set(areas) <= {"road", "sidewalk", "crosswalk", "grass", "block"}
    wanted = np.array([navigation_area(one) for one in package.node])
    for area in set(areas):
        mine, theirs = site[np.array(areas) == area], package.corners[wanted == area]
        assert len(mine) == len(theirs)
        for one, other in ((mine, theirs), (-mine, -theirs)):
            assert np.allclose(one.min(axis=(0, 1)), other.min(axis=(0, 1)), atol=0.01)
    walked = site[np.array(areas) == "sidewalk"]
    up = np.cross(walked[:, 1] - walked[:, 0], walked[:, 2] - walked[:, 0])[:, 2]
    assert up.sum() > 0


def test_crosswalks_are_convex_and_face_up(package):
    """``get_xodr_crosswalks.py`` triangulates them as fans; one closed ring follows another."""
    corners = np.array(package.carla["crosswalks"]).reshape(-1, 3) * [1, -1, 1]
    rings, start = [], 0
    for k in range(1, len(corners)):
        if k > start and np.allclose(corners[k], corners[start], atol=1e-4):
            rings.append(corners[start:k, :2])
            start = k + 1
    assert rings
    for ring in rings:
        shape = shapely.Polygon(ring)
        assert shape.is_valid
        assert shape.area >= 0.99 * shape.convex_hull.area
        assert shapely.LinearRing(ring).is_ccw
