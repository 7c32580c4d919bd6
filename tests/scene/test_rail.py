"""Tracks: gauge by casting, rails in the pavement and on ballast, platforms."""

import numpy as np
import pytest
from shapely import LineString, Point, Polygon, box

from urbantwin.geometry import DownwardProbe
from urbantwin.scene.rail import rail_mesh
from urbantwin.site.extract import OsmFeature
from urbantwin.taxonomy import material_id

REGION = box(-100, -100, 100, 100)
ROAD = box(-100, -6, 100, 6)


def flat(xy):
    return np.zeros(len(xy))


def feature(geometry, number=1, **tags):
    return OsmFeature("node" if isinstance(geometry, Point) else "way", number, tags, geometry)


def build(*features, ground=flat, road=ROAD, **more):
    return rail_mesh(features, region=REGION, ground_height=ground, carriageway=road, **more)


@pytest.mark.parametrize(("said", "gauge"), [(None, 1.435), ("1000", 1.0), ("1524", 1.524)])
def test_rays_find_two_rails_at_their_gauge(said, gauge):
    tags = {"railway": "tram"} | ({"gauge": said} if said else {})
    mesh, _ = build(feature(LineString([(-50, 0), (50, 0)]), **tags))
    across = np.arange(-1.5, 1.5, 0.0005)
    places = np.column_stack([np.full(len(across), 7.3), across, np.ones(len(across))])
    hit = np.isfinite(DownwardProbe(mesh).height_below(places))
    inner = [across[hit & (across > 0)].min(), across[hit & (across < 0)].max()]
    assert inner[0] - inner[1] == pytest.approx(gauge, abs=0.002)
    assert hit.mean() == pytest.approx(2 * 0.07 / 3.0, rel=0.02)


def test_tram_rails_lie_flush_in_the_street_and_follow_its_slope():
    mesh, notes = build(
        feature(LineString([(-50, 0), (50, 0)]), railway="tram"), ground=lambda xy: 0.05 * xy[:, 0]
    )
    above = mesh.vertices[:, 2] - 0.05 * mesh.vertices[:, 0]
    assert 0.0 < above.max() < 0.006
    assert notes == {"tracks, m": 100}
    assert set(mesh.material) == {material_id("metal-bare")}


def test_trains_run_on_ballast_and_sleepers_and_come_down_at_level_crossings():
    mesh, notes = build(
        feature(LineString([(0, -90), (0, 90)]), railway="rail"), road=box(-100, -4, 100, 4)
    )
    assert notes["sleepers"] > 150
    probe = DownwardProbe(mesh)
    rail = 1.435 / 2 + 0.03
    heights = probe.height_below([[rail, y, 5.0] for y in (0.3, 3.0, 40.3, -80.1)])
    assert heights[:2] == pytest.approx([0.004, 0.004], abs=1e-6)
    assert heights[2:] == pytest.approx([0.554, 0.554], abs=1e-6)
    bed = mesh.select(mesh.material == material_id("gravel")).vertices
    assert np.abs(bed[:, 1]).min() > 4.5
    assert bed[:, 2].min() == pytest.approx(-0.3)


def test_tracks_below_ground_or_gone_are_not_drawn():
    line = LineString([(-50, 0), (50, 0)])
    for tags in (
        {"railway": "tram", "tunnel": "yes"},
        {"railway": "abandoned"},
        {"railway": "subway"},
        {"railway": "rail", "layer": "-1"},
    ):
        assert build(feature(line, **tags))[1] == {}


def test_platforms_have_their_height_and_keep_off_track_and_road():
    track = feature(LineString([(-50, 20), (50, 20)]), 1, railway="rail")
    area = feature(box(-30, 20.5, 30, 24), 2, railway="platform", height="0.76")
    mesh, notes = build(track, area)
    assert notes["platforms"] == 1
    top = DownwardProbe(mesh).height_below([[0, 23, 5.0], [0, 21.0, 5.0]])
    assert top[0] == pytest.approx(0.76)
    assert not top[1] > 0.7  # within the structure gauge of the track
    bus = feature(box(-30, 6, 30, 9), 3, public_transport="platform", bus="yes")
    assert build(bus)[1] == {}


def test_every_solid_is_closed():
    mesh, _ = build(
        feature(LineString([(-50, 20), (0, 30), (50, 20)]), 1, railway="rail"),
        feature(box(-30, 22, 30, 26), 2, railway="platform"),
        road=Polygon(),
    )
    edges = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    assert set(np.unique(edges, axis=0, return_counts=True)[1]) == {2}
    assert mesh.areas().min() > 1e-7
