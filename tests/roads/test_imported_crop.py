"""A map cut to the region: what is left lies where it lay, and what is dropped is told."""

import dataclasses
import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from urbantwin.roads.imported.crop import cropped, main_part, part_of_road, with_border
from urbantwin.roads.model import LaneModel, Profile, RoadLink, splined
from urbantwin.roads.region_pieces import Part, main_component

from . import lane_town
from .tee import EAST, FAR, JUNCTION, MOUTH, SOUTH, WEST, tee


def union(*models):
    """Several models as one, their ids apart."""
    roads, junctions = [], []
    for k, model in enumerate(models):
        step = 1000 * k

        def link(old, step=step):
            return old and dataclasses.replace(old, id=old.id + step)

        roads += [
            dataclasses.replace(
                road,
                id=road.id + step,
                junction=road.junction + step if road.junction >= 0 else -1,
                predecessor=link(road.predecessor),
                successor=link(road.successor),
            )
            for road in model.roads
        ]
        junctions += [
            dataclasses.replace(
                junction,
                id=junction.id + step,
                connections=tuple(
                    dataclasses.replace(
                        c, incoming=c.incoming + step, connecting=c.connecting + step
                    )
                    for c in junction.connections
                ),
            )
            for junction in model.junctions
        ]
    return LaneModel(models[0].driving_side, tuple(roads), tuple(junctions))


def street_ids(model):
    return {road.id for road in model.roads if road.junction < 0}


def test_straight_streets_end_at_the_border():
    model = cropped(tee(), shapely.box(-100.0, -50.0, 60.0, 50.0))
    lengths = {road.id: road.length for road in model.roads if road.junction < 0}
    assert lengths == pytest.approx(
        {WEST: 100 - MOUTH, EAST: 60 - MOUTH, SOUTH: 50 - MOUTH}, abs=0.002
    )
    west, east = model.road_by_id[WEST], model.road_by_id[EAST]
    assert west.predecessor is None
    assert west.successor == RoadLink("junction", JUNCTION)
    assert east.successor is None
    assert np.allclose(west.curve.at([0.0])[0], [-100, 0, 0], atol=0.002)
    # The turn lane's section began 40 m behind the old start, 20 m of which are gone.
    assert [section.s for section in west.sections] == pytest.approx([0.0, 20.0], abs=0.002)


@settings(max_examples=10, deadline=None)
@given(a=st.floats(0.0, 0.8), share=st.floats(0.1, 1.0), side=st.sampled_from(["right", "left"]))
def test_a_part_of_a_road_is_that_part(a, share, side):
    """Whatever the reference line and the profiles are made of, nothing moves."""
    for road in lane_town.town(side).roads:
        first = a * road.length
        last = first + max(0.05, share * (road.length - first))
        last = min(last, road.length)
        part = part_of_road(road, first, last, 77)
        assert part.length == pytest.approx(last - first, abs=2e-3)
        s = np.linspace(0.002, part.length - 0.002, 17)
        offset = first if first > 1e-3 else 0.0
        for t in (-4.0, 0.0, 3.0):
            assert np.abs(part.place(s, t) - road.place(s + offset, t)).max() < 1e-6
        for here in s:
            new, old = part.section_at(here), road.section_at(here + offset)
            assert [lane.id for lane in new.lanes] == [lane.id for lane in old.lanes]
            for lane in new.lanes:
                borders = [
                    r.border(x, x.by_id[lane.id], at, outer=True)
                    for r, x, at in ((part, new, here), (road, old, here + offset))
                ]
                assert borders[0] == pytest.approx(borders[1], abs=1e-6)


def test_a_new_section_border_changes_nothing():
    road = lane_town.town().road_by_id[1]
    cut, number = with_border(road, 10.0)
    assert number == 1
    s = np.linspace(0.0, road.length, 101)
    for lane in cut.sections[1].lanes:
        assert lane.predecessor == lane.id
    for at in s:
        a, b = road.section_at(at), cut.section_at(at)
        for lane in a.lanes:
            assert cut.border(b, b.by_id[lane.id], at, outer=True) == pytest.approx(
                road.border(a, lane, at, outer=True), abs=1e-9
            )


def test_a_street_that_leaves_and_comes_back_becomes_two():
    curve = splined(np.array([[-100.0, 0], [-40, 60], [40, 60], [100, 0]]), 1.0, -1.0)
    model = tee(crosswalk=False)
    bow = dataclasses.replace(model.road_by_id[EAST], id=7, curve=curve, predecessor=None)
    model = LaneModel("right", (bow,))
    region = shapely.box(-90.0, -10.0, 90.0, 50.0)
    pieces = cropped(model, region).roads
    assert len(pieces) == 2
    assert {piece.id for piece in pieces} >= {7}
    whole = shapely.LineString(curve.at(np.linspace(0, curve.length, 2000))[:, :2])
    inside = shapely.intersection(whole, region)
    assert sum(piece.length for piece in pieces) == pytest.approx(inside.length, abs=0.05)
    for piece in pieces:
        assert region.buffer(0.01).covers(piece.curve.line)


def test_a_junction_within_keeps_stubs_of_its_streets():
    model = cropped(tee(), shapely.Point(0.0, 0.0).buffer(10.0))
    assert street_ids(model) == {WEST, EAST, SOUTH}
    assert all(road.length == pytest.approx(15.0) for road in model.roads if road.junction < 0)
    assert len(model.junctions[0].connections) == 6


def test_a_junction_outside_goes_with_its_ways():
    model = cropped(tee(), shapely.box(30.0, -20.0, 200.0, 20.0))
    assert street_ids(model) == {EAST}
    assert not model.junctions
    (road,) = model.roads
    assert road.predecessor is None
    assert road.length == pytest.approx(FAR - 30.0, abs=0.002)
    assert not model.areas


def test_what_stands_on_a_street_keeps_its_place():
    whole = tee(signals=True)
    model = cropped(whole, shapely.box(-100.0, -50.0, 60.0, 50.0))
    for before, after in ((whole.signals, model.signals), (whole.areas, model.areas)):
        assert [item.id for item in before] == [item.id for item in after]
        for a, b in zip(before, after, strict=True):
            places = [
                m.road_by_id[item.road].curve.beside([item.s], [getattr(item, "t", 0.0)])[0]
                for m, item in ((whole, a), (model, b))
            ]
            assert np.allclose(*places, atol=0.002)
    assert model.controllers == whole.controllers


def test_the_smaller_of_two_places_is_left_out_and_told():
    far = tee(at=(0.0, 300.0))
    small = cropped(far, shapely.Point(0.0, 300.0).buffer(50.0))
    model, left = main_part(union(tee(), small))
    assert street_ids(model) == {WEST, EAST, SOUTH}
    (item,) = left
    assert item.roads == 3
    assert item.metres == pytest.approx(3 * (50 - MOUTH), abs=0.1)
    assert set(item.names) == {"Long Street", "Short Street"}
    assert item.as_note()["names"] == "Long Street, Short Street"


def test_a_street_that_passes_over_stays():
    """It is not joined to the junction below, and yet it is part of the place."""
    bridge = dataclasses.replace(
        tee().road_by_id[EAST],
        id=7,
        predecessor=None,
        elevation=Profile.constant(7.0),
        curve=splined(np.array([[60.0, -80], [60, 80]]), math.pi / 2, math.pi / 2),
    )
    other = dataclasses.replace(
        bridge, id=8, curve=splined(np.array([[200.0, -80], [200, -40]]), 1.57, 1.57)
    )
    model = tee()
    model, left = main_part(model.with_roads((*model.roads, bridge, other)))
    assert street_ids(model) == {WEST, EAST, SOUTH, 7}
    assert [item.roads for item in left] == [1]


@settings(max_examples=50, deadline=None)
@given(
    lanes=st.lists(st.integers(0, 4), min_size=2, max_size=12),
    joints=st.lists(st.tuples(st.integers(0, 11), st.integers(0, 11)), max_size=12),
)
def test_nothing_is_lost_or_counted_twice(lanes, joints):
    """Kept and left out are all there is; against a union-find of its own."""
    parent = list(range(len(lanes)))

    def top(k):
        while parent[k] != k:
            k = parent[k]
        return k

    shared = {k: set() for k in parent}
    for number, (a, b) in enumerate(joints):
        if a < len(lanes) and b < len(lanes):
            shared[a].add(number)
            shared[b].add(number)
            parent[top(a)] = top(b)
    parts = {  # apart in plan, so that none crosses another
        k: Part("", shapely.LineString([(0, 10 * k), (5, 10 * k)]), float(n), frozenset(shared[k]))
        for k, n in enumerate(lanes)
    }
    kept, left = main_component(parts)
    weight = {}
    for k, n in enumerate(lanes):
        weight[top(k)] = weight.get(top(k), 0) + n
    assert sum(item.roads for item in left) + len(kept) == len(lanes)
    for k in parts:
        assert (k in kept) == all(other in kept for other in parts if top(other) == top(k))
        if weight[top(k)] > 0 and k in kept:
            assert weight[top(k)] == max(weight.values())
