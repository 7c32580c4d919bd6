"""A surveyed junction: the Lanelet2 map of k733 in Karlsruhe, and what drove there."""

import csv
import runpy
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import shapely

from urbantwin.geometry import SiteFrame
from urbantwin.roads.lanelet2 import anchor_of, is_lanelet2
from urbantwin.roads.lanelet2.read import translate
from urbantwin.roads.opendrive import write_opendrive

HERE = Path(__file__).parent
RULER = SimpleNamespace(**runpy.run_path(str(HERE / "lanelet_ruler.py")))
ANCHOR = (49.005306, 8.4374089)


@pytest.fixture(scope="module")
def k733(shared_data):
    """The map read by us, and the same file read by the ruler."""
    path = shared_data / "tracks" / "karlsruhe-k733" / "k733.lanelet2.osm"
    return translate(path, SiteFrame(*ANCHOR)), RULER.Drawn(path, ANCHOR), path


def test_it_is_told_from_a_street_map(shared_data, k733):
    assert is_lanelet2(k733[2])
    assert not is_lanelet2(shared_data / "osm" / "munich.osm")
    assert np.abs(np.subtract(anchor_of(k733[2]), ANCHOR)).max() < 5e-4  # some 40 m


def test_every_bound_is_a_border_of_lanes_within_a_centimetre(k733):
    read, drawn, _ = k733
    away = RULER.farthest(drawn, read.model, read.lanes)
    assert len(away) == 38
    assert max(away.values()) < 0.01


def test_lanes_follow_as_the_shared_points_say(k733):
    read, drawn, _ = k733
    assert RULER.lanelet_links(read.model, read.lanes, drawn) == drawn.followers()


def test_lanes_follow_as_the_routing_graph_of_lanelet2_says(k733):
    lanelet2 = pytest.importorskip("lanelet2")
    for part in ("io", "projection", "routing", "traffic_rules"):
        pytest.importorskip(f"lanelet2.{part}")
    read, drawn, path = k733
    projector = lanelet2.projection.UtmProjector(lanelet2.io.Origin(*ANCHOR))
    chart = lanelet2.io.load(str(path), projector)
    rules = lanelet2.traffic_rules.create(
        lanelet2.traffic_rules.Locations.Germany, lanelet2.traffic_rules.Participants.Vehicle
    )
    graph = lanelet2.routing.RoutingGraph(chart, rules)
    said = {(a.id, b.id) for a in chart.laneletLayer for b in graph.following(a)}
    assert RULER.lanelet_links(read.model, read.lanes, drawn) == said


def test_what_drove_there_drove_on_lanes(k733):
    """Where the map has lanes: one lane of the approach from the south is not in it."""
    read, drawn, path = k733
    with (path.parent / "vehicle_tracks_000.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["agent_type"] in ("Car", "Truck")]
    xy, speed = (
        np.array([[float(r[k]) for k in ks] for r in rows]) for ks in (("x", "y"), ("vx", "vy"))
    )
    lanes = {key for keys in read.lanes.values() for key in keys}
    lanes |= {key for pair in RULER.lane_links(read.model) for key in pair}
    ours = shapely.union_all([RULER.lane_area(read.model, key) for key in sorted(lanes)])
    theirs = shapely.union_all([drawn.area(i) for i in drawn.lanelets])
    moving = np.hypot(*speed.T) > 2.0
    xy = xy[moving & shapely.contains_xy(theirs.convex_hull, *xy.T)]
    on_ours, on_theirs = (shapely.contains_xy(area, *xy.T) for area in (ours, theirs))
    assert len(xy) > 3000
    assert on_ours.mean() > 0.9
    assert (on_theirs & ~on_ours).mean() < 0.001


def test_what_is_odd_in_the_map_is_said(k733):
    notes = k733[0].notes
    # Two slip lanes end on a lane without sharing its points.
    assert notes["lanelets_that_end_on_others_without_sharing_points"] == [-104342, -104341]
    assert notes["lines_between_lanes"].startswith("assumed")


def test_the_same_map_gives_the_same_bytes(k733, tmp_path):
    read, _, path = k733
    for k in (0, 1):
        (read if k else translate(path, SiteFrame(*ANCHOR))).model.save(tmp_path / f"{k}.json")
    assert (tmp_path / "0.json").read_bytes() == (tmp_path / "1.json").read_bytes()


@pytest.mark.thorough
def test_the_judges_of_opendrive_find_no_fault(k733, tmp_path, judge):
    model = k733[0].model
    tasks = []
    for version in ("1.8", "1.4"):
        path = tmp_path / f"k733-{version}.xodr"
        write_opendrive(model, SiteFrame(*ANCHOR), path, version=version, name="k733")
        tasks.append(f"check={path}")
    tasks.append(f"carla={path}")
    answers = judge("asam_and_carla", *tasks)
    assert [answers[task]["issues"] for task in tasks[:2]] == [[], []]
    carla = answers[tasks[2]]
    # A way ends only where the map does: at streets that nothing follows.
    open_roads = {road.id for road in model.roads if road.junction < 0 and not road.successor}
    assert {row[0] for row in carla["dead_ends"]} <= open_roads
    assert {row[0] for row in carla["waypoints"]} == {road.id for road in model.roads}
    assert carla["origin"] == pytest.approx(list(ANCHOR), abs=1e-6)
