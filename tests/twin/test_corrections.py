"""A twin mended by hand: what was drawn stands there, in every form that the twin has."""

import json
import math
import re
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely

from urbantwin.drawing.pictures import figure_of_twin
from urbantwin.geometry.rays import RayScene
from urbantwin.roads import sumo_binary
from urbantwin.roads.opendrive import write_opendrive
from urbantwin.scene import PARTS
from urbantwin.site import load_site
from urbantwin.taxonomy import semantic_id
from urbantwin.twin import build_twin, load_twin

SITE = """
name: mended
anchor: {latitude: 48.7, longitude: 9.18}
region: {radius_m: 90}
osm: map.osm
scene: {clutter: none}
closed_loop: false
traffic: {per_hour: {car: 60}, duration_s: 1}
rig: {sensors: [{name: a, model: VLP-16, east_m: 20, north_m: 20, height_m: 4}]}
"""
STREET = {"highway": "residential", "lanes": "2", "width": "6", "sidewalk": "both"}
NODES = {
    1: (-200, 0, {}), 2: (0, 0, {}), 3: (200, 0, {}), 4: (0, -200, {}), 5: (0, 200, {}),
    6: (-30, -25, {"natural": "tree"}), 7: (-40, -25, {"natural": "tree"}),
    8: (-35, 25, {"natural": "tree"}), 9: (-47, 25, {"man_made": "pole", "height": "6"}),
    12: (-60, -40, {"barrier": "bollard"}),
}  # fmt: skip
WAYS = {
    10: ([1, 2, 3], STREET),
    11: ([4, 2, 5], STREET),
}
#: Where the curbs of the street to the north are drawn: as the map has it, they lie at 3 m.
EAST_CURB_M, WEST_CURB_M = 2.6, -4.5
WALL_M, THICKNESS_M = -30.0, 0.4


def point(x, y):
    return {"type": "Point", "coordinates": [x, y]}


def line(*points):
    return {"type": "LineString", "coordinates": [list(one) for one in points]}


CORRECTIONS = [
    ({"action": "tag", "element": "way/11", "tags": {"maxspeed": 20}}, None),
    ({"action": "add", "what": "pole", "height_m": 8}, point(-25, 20)),
    (
        {"action": "add", "what": "wall", "height_m": 3, "thickness_m": THICKNESS_M},
        line((40, WALL_M), (60, WALL_M)),
    ),
    ({"action": "add", "what": "tree", "height_m": 9, "crown_m": 5}, point(30, 35)),
    (
        {"action": "add", "what": "lane", "side": "right", "kind": "bicycle", "width_m": 1.8},
        line((30, 0.4), (70, 0.4)),
    ),
    ({"action": "remove", "element": "node/6"}, None),
    ({"action": "remove", "what": "tree"}, point(-40.5, -25.5)),
    ({"action": "remove", "what": "pole", "radius_m": 3}, point(30, -60)),
    ({"action": "move", "what": "curb"}, line((EAST_CURB_M, 30), (EAST_CURB_M, 60))),
    ({"action": "move", "what": "curb"}, line((WEST_CURB_M, 60), (WEST_CURB_M, 30))),
]  # fmt: skip


@pytest.fixture
def site(tmp_path, write_osm):
    write_osm(NODES, WAYS)
    features = [
        {"type": "Feature", "properties": properties, "geometry": geometry}
        for properties, geometry in CORRECTIONS
    ]
    file = {"type": "FeatureCollection", "crs": "site", "features": features}
    (tmp_path / "corrections.geojson").write_text(json.dumps(file))
    (tmp_path / "site.yaml").write_text(SITE)
    return tmp_path / "site.yaml"


@pytest.fixture
def twin(site, made_once):
    return load_twin(made_once("mended", lambda out: build_twin(load_site(site), out / "t")) / "t")


def test_without_what_stands_beside_streets_there_are_no_bollards(twin):
    standing = twin.mesh.triangles()[twin.mesh.semantic == semantic_id("pole")].reshape(-1, 3)
    assert len(standing)
    assert np.hypot(*(standing[:, :2] - [-60, -40]).T).min() > 5


def test_each_is_told(twin):
    applied = [one.applied for one in twin.corrections]
    assert applied == [True] * 7 + [False] + [True] * 2
    counted = twin.manifest["notes"]["corrections"]
    assert (counted["applied"], counted["not_applied"]) == (9, 1)
    (warning,) = [one for one in twin.warnings if one.about == "corrections"]
    assert "feature 8 (remove pole)" in warning.problem
    away = float(re.search(r"the nearest is ([\d.]+) m away", warning.reason)[1])
    assert away == pytest.approx(math.hypot(-47 - 30, 25 + 60), abs=0.2)


def test_the_file_is_an_input(twin):
    (one,) = [one for one in twin.manifest["inputs"] if one["kind"] == "corrections"]
    assert one["name"] == "corrections.geojson"
    assert len(one["sha256"]) == 64
    named = [one["name"] for one in twin.manifest["made_from"]["files"]]
    assert "corrections.geojson" in named
    assert twin.manifest["made_from"]["site"]["corrections"]["file"] == "corrections.geojson"


def standing(twin, name):
    """Where parts with faces of a class stand in plan, and how high they are."""
    mesh = twin.mesh
    found = {}
    for part in np.unique(mesh.part[mesh.semantic == semantic_id(name)]):
        points = mesh.vertices[np.unique(mesh.faces[mesh.part == part])]
        low = points[points[:, 2] < points[:, 2].min() + 0.05]
        found[tuple(low[:, :2].mean(axis=0))] = points[:, 2].max()
    return found


def nearest(places, x, y):
    return min(math.dist(place, (x, y)) for place in places)


def test_trees_and_poles_stand_where_they_were_drawn_and_not_where_they_were_removed(twin):
    trees, poles = standing(twin, "trunk"), standing(twin, "pole")
    assert nearest(trees, 30, 35) < 0.01
    assert nearest(trees, -35, 25) < 0.3  # the map's own
    assert nearest(trees, -30, -25) > 20
    assert nearest(trees, -40, -25) > 20
    (top,) = [height for place, height in poles.items() if math.dist(place, (-25, 20)) < 0.01]
    assert top == pytest.approx(8.0, abs=0.05)  # above the ground, which is not quite level


def cast(twin, origins, directions):
    """Ranges of rays, and the classes that they meet."""
    mesh = twin.mesh
    hits = RayScene(mesh.vertices, mesh.faces).cast(origins, np.asarray(directions, np.float32))
    return hits.range_m, mesh.semantic[hits.face]


def test_rays_meet_the_wall_at_the_range_of_its_face(twin):
    x = np.linspace(41, 59, 7)
    origins = np.column_stack([x, np.full(7, -12.0), np.full(7, 1.5)])
    for tilt in (0.0, 0.05):
        ahead = np.tile([0.0, -math.cos(tilt), math.sin(tilt)], (7, 1))
        distance, classes = cast(twin, origins, ahead)
        expected = (-12.0 - (WALL_M + THICKNESS_M / 2)) / math.cos(tilt)
        assert np.abs(distance - expected).max() < 1e-3
        assert set(classes) == {semantic_id("fence")}


def test_rays_pass_where_a_tree_was_removed(twin):
    z = np.linspace(0.3, 9.0, 30)
    for x in (-30.0, -40.0):
        origins = np.column_stack([np.full(30, x), np.full(30, -17.0), z])
        distance, _ = cast(twin, origins, np.tile([0.0, -1.0, 0.0], (30, 1)))
        assert (distance > 16).all()


def curb_segments(mesh):
    """The curb's upright faces, seen from above."""
    found = []
    for corners in mesh.triangles()[mesh.part == PARTS["curb"]][:, :, :2]:
        edges = corners - np.roll(corners, -1, axis=0)
        k = int(np.linalg.norm(edges, axis=1).argmax())
        found.append(corners[[k, (k + 1) % 3]])
    return shapely.union_all(shapely.linestrings(found))


def test_curbs_lie_on_the_lines_that_were_drawn(twin):
    curbs = curb_segments(twin.mesh)
    for x in (EAST_CURB_M, WEST_CURB_M):
        drawn = shapely.points(np.full(40, x), np.linspace(30, 60, 40))
        assert shapely.distance(drawn, curbs).max() < 0.05
    before = shapely.points([3.0, -3.0], [75.0, 75.0])
    assert shapely.distance(before, curbs).max() < 0.05  # beyond, they are as the map has them


def lanes_at(network, x, y):
    """Lanes of another program's network that pass over a place: kinds of users and widths."""
    root = ElementTree.parse(network).getroot()
    shift = np.array([float(v) for v in root.find("location").get("netOffset").split(",")])
    found = []
    for lane in root.iter("lane"):
        points = np.array([[float(v) for v in p.split(",")[:2]] for p in lane.get("shape").split()])
        width = float(lane.get("width", 3.2))
        over = shapely.LineString(points - shift).buffer(width / 2, cap_style="flat")
        if over.covers(shapely.Point(x, y)):
            found.append((lane, width))
    return found


def test_another_program_finds_the_lanes_in_opendrive(twin, tmp_path):
    """SUMO's netconvert reads the OpenDRIVE map: a bicycle lane along the stretch alone, and the
    lane beside the curb that moved inwards is narrower by as much."""
    file = tmp_path / "mended.xodr"
    write_opendrive(twin.lane_model, twin.frame, file, version="1.4", name="mended")
    network = tmp_path / "read.net.xml"
    command = [sumo_binary("netconvert"), "--opendrive-files", file, "--output-file", network]
    command += [
        "--opendrive.import-all-lanes",
        "--opendrive.curve-resolution",
        "0.5",
        "--no-warnings",
    ]
    subprocess.run([*command, "--no-turnarounds"], check=True, capture_output=True)
    beside = [width for _, width in lanes_at(network, 50, -3.9)]
    assert pytest.approx(1.8, abs=0.01) in beside
    assert pytest.approx(1.8, abs=0.01) not in [w for _, w in lanes_at(network, 80, -3.9)]


def test_traffic_has_the_lane_and_the_limit(twin):
    root = ElementTree.parse(twin.net_path).getroot()
    bicycles = [
        lane
        for edge in root.iter("edge")
        if edge.get("function") is None
        for lane in edge.iter("lane")
        if lane.get("allow") == "bicycle"
    ]
    # At both ends of the 40 m that were drawn it opens and closes over some metres.
    assert 20 < sum(float(lane.get("length")) for lane in bicycles) < 40
    limits = {round(float(lane.get("speed")), 2) for lane in root.iter("lane")}
    assert round(20 / 3.6, 2) in limits


def test_the_plan_shows_and_lists_each(twin):
    figure = figure_of_twin(twin, "plan")
    texts = [one.get_text() for one in figure.texts]
    assert "corrections: 9 applied, 1 not (dashed)" in texts
    numbers = {one.get_text() for one in figure.axes[0].texts}
    assert {str(k) for k in range(1, 11)} <= numbers


def test_the_plan_writes_whatever_a_tag_says(twin, tmp_path):
    strange = [{**one.model_dump(), "told": "name=$\\frac{$ \x1b[31m\n \u6f22" + 200 * "x"}
               for one in 5 * twin.corrections]  # fmt: skip
    notes = {**twin.manifest["notes"], "corrections": {"each": strange}}
    other = type(twin)(twin.folder, {**twin.manifest, "notes": notes})
    figure_of_twin(other, "plan").savefig(tmp_path / "plan.png")


def test_the_same_corrections_give_the_same_twin(twin, site, tmp_path):
    again = build_twin(load_site(site), tmp_path / "again")
    assert again.manifest["files"] == twin.manifest["files"]
    assert again.manifest["notes"] == twin.manifest["notes"]


def test_an_element_that_is_not_in_the_map_is_refused(site):
    file = site.parent / "corrections.geojson"
    value = json.loads(file.read_text())
    value["features"][0]["properties"]["element"] = "way/6"
    file.write_text(json.dumps(value))
    with pytest.raises(
        Exception, match=r"feature 1 \(tag\).*way/6, which is not in map.osm; expected node/6"
    ):
        build_twin(load_site(site), site.parent / "t")


def test_corrections_of_a_site_are_those_beside_it_those_named_or_none(site):
    beside = site.parent / "corrections.geojson"
    assert load_site(site).corrections.path == beside
    site.write_text(SITE + "corrections: null\n")
    assert load_site(site).corrections is None
    beside.rename(site.parent / "mine.geojson")
    site.write_text(SITE + "corrections: {file: mine.geojson, attribution: me}\n")
    assert load_site(site).corrections.attribution == "me"
    assert Path(load_site(site).resolved()["corrections"]["file"]).name == "mine.geojson"
