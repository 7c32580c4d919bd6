"""Bridges of ways that are not roads: clearance by casting, ramps, railings; covered ways."""

import numpy as np
import pytest
from shapely import LineString, Point, Polygon, box

from urbantwin.geometry import DownwardProbe
from urbantwin.scene.bridge import bridge_decks, bridge_mesh
from urbantwin.site.extract import OsmFeature
from urbantwin.taxonomy import semantic_id

REGION = box(-100, -100, 100, 100)
ROAD = box(-100, -6, 100, 6)
STREET = LineString([(-100, 0), (100, 0)])


def flat(xy):
    return np.zeros(len(xy))


def feature(geometry, number=1, **tags):
    return OsmFeature("node" if isinstance(geometry, Point) else "way", number, tags, geometry)


def build(*features, ground=flat, road=ROAD, lane_decks=None):
    decks, found = bridge_decks(
        features, region=REGION, ground_height=ground, lane_decks=lane_decks or Polygon()
    )
    mesh, notes = bridge_mesh(
        features, decks, region=REGION, ground_height=ground, carriageway=road
    )
    return mesh, {**found, **notes}


def over_a_street(*more):
    return build(
        feature(STREET, 1, highway="primary"),
        feature(LineString([(0, -20), (0, 20)]), 2, highway="footway", bridge="yes", width="3"),
        *more,
    )


RAMPS = (
    feature(LineString([(0, 20), (0, 80)]), 3, highway="footway"),
    feature(LineString([(0, -20), (30, -20)]), 4, highway="steps"),
)


def test_a_footbridge_clears_the_street_and_is_reached_by_ramp_and_steps():
    mesh, notes = over_a_street(*RAMPS)
    assert notes["bridges"] == 1
    assert notes["ramps to bridges"] == 2
    probe = DownwardProbe(mesh)
    deck = probe.height_below([[0.05, y, 20.0] for y in np.linspace(-19, 19, 20)])
    assert np.isfinite(deck).all()
    # From the road upward: the first thing is the underside, at least 4.7 m up.
    under = mesh.vertices[np.abs(mesh.vertices[:, 1]) < 6]
    assert under[:, 2].min() >= 4.7 - 1e-6
    ramp = probe.height_below([[0.05, y, 20.0] for y in (21.0, 30.0, 60.0)])
    slope = -np.diff(ramp[:2])[0] / 9.0
    assert slope == pytest.approx(0.12, abs=0.005)
    assert ramp[2] < 0.4
    steps = probe.height_below([[x, -20.05, 20.0] for x in (2.0, 6.0)])
    assert -np.diff(steps)[0] / 4.0 == pytest.approx(0.5, abs=0.02)


def test_without_a_ramp_the_deck_itself_comes_down():
    mesh, notes = over_a_street()
    assert notes["bridges that slope down to a road"] == 2
    ends = DownwardProbe(mesh).height_below([[0.05, y, 20.0] for y in (-19.9, 19.9)])
    assert (ends < 0.3).all()
    under = mesh.vertices[np.abs(mesh.vertices[:, 1]) < 3]
    assert under[:, 2].min() > 4.0


def test_a_bridge_from_bank_to_bank_needs_no_lift():
    def gorge(xy):
        return np.where(np.abs(xy[:, 1]) < 15, -8.0, 0.0)

    mesh, notes = build(
        feature(STREET, 1, highway="primary"),
        feature(LineString([(0, -20), (0, 20)]), 2, highway="footway", bridge="yes"),
        ground=gorge,
    )
    deck = DownwardProbe(mesh).height_below([[0.05, y, 20.0] for y in (-10, 0, 10)])
    assert deck == pytest.approx([0, 0, 0], abs=1e-6)
    assert notes["piers"] >= 1
    low = mesh.vertices[(mesh.vertices[:, 2] < -7) & (np.abs(mesh.vertices[:, 0]) < 5)]
    assert len(low) > 0
    assert np.abs(low[:, 1]).min() > 6  # no pier on the street


def test_railings_keep_people_on_the_deck_and_let_beams_pass():
    mesh, _ = over_a_street(*RAMPS)
    fence = mesh.select(mesh.semantic == semantic_id("fence"))
    rail = fence.vertices[np.abs(fence.vertices[:, 1]) < 15]
    assert np.abs(rail[:, 0]).min() > 1.3
    assert np.ptp(rail[:, 2]) == pytest.approx(1.1 + 0.3, abs=0.05)


def test_bridges_that_lane_decks_carry_are_not_drawn_twice():
    _, notes = build(
        feature(LineString([(0, -20), (0, 20)]), 2, highway="footway", bridge="yes"),
        lane_decks=box(-5, -30, 5, 30),
    )
    assert notes == {"bridges that roads' decks carry": 1}


def test_a_railway_bridge_clears_the_street_by_more():
    mesh, _ = build(
        feature(STREET, 1, highway="primary"),
        feature(LineString([(0, -120), (0, 120)]), 2, railway="rail", bridge="yes"),
    )
    deck = DownwardProbe(mesh).height_below([[0.05, 0.0, 20.0]])
    assert deck[0] == pytest.approx(4.7 + 1.0, abs=0.01)


def test_a_bridge_area_is_the_plan_of_its_deck():
    outline = feature(box(-4, -22, 4, 22), 9, man_made="bridge")
    narrow, _ = over_a_street(*RAMPS)
    mesh, _ = over_a_street(*RAMPS, outline)
    places = [[3.5, y, 20.0] for y in (-10.0, 10.0)]
    assert np.isfinite(DownwardProbe(mesh).height_below(places)).all()
    assert not np.isfinite(DownwardProbe(narrow).height_below(places)).any()


def test_a_covered_way_has_a_roof_on_posts():
    mesh, notes = build(
        feature(LineString([(10, 20), (40, 20)]), 1, highway="footway", covered="yes")
    )
    assert notes == {"covered ways": 1}
    roof = DownwardProbe(mesh).height_below([[25, 20, 20.0]])
    assert roof[0] == pytest.approx(2.85)
    assert mesh.vertices[:, 2].min() < 0


def test_solids_are_closed():
    mesh, _ = over_a_street(*RAMPS)
    edges = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    assert set(np.unique(edges, axis=0, return_counts=True)[1]) == {2}
    assert mesh.areas().min() > 1e-7
    assert np.isfinite(mesh.vertices).all()
