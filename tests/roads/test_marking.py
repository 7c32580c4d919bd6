"""Paint on roads: areas and places worked out by hand."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
import shapely

from urbantwin.roads import RoadNetwork
from urbantwin.roads.marking import PAINT_KINDS, painted
from urbantwin.roads.model import (
    Curve,
    LaneModel,
    LaneSection,
    ModelJunction,
    ModelRoad,
    Piece,
    Profile,
    RoadLink,
    RoadSignal,
    SectionLane,
)
from urbantwin.roads.network import Lane

ZERO = Profile.constant(0.0)
EMPTY = RoadNetwork("right", (), (), (), (), ())


def street(lanes, signals=(), length=60.0, level=0):
    """A street to the east, its reference line on the x axis."""
    curve = Curve((Piece(0.0, 0.0, 0.0, length),))
    section = LaneSection(0.0, tuple(lanes))
    road = ModelRoad(1, "", "", (), -1, curve, ZERO, ZERO, ZERO, ZERO, (section,), level=level)
    return LaneModel("right", (road,), (), (), tuple(signals), ())


def lane(number, kind="driving", width=3.0, **more):
    return SectionLane(number, kind, Profile.constant(width), number < 0, **more)


def sign(kind, orientation="+", lanes=()):
    x = 58.0 if orientation == "+" else 2.0
    return RoadSignal(
        9, 1, "", False, "DE", kind, "-1", float("nan"), "", x, -5.0, 2.0, orientation, lanes
    )


def quads(model, *kinds):
    return painted(EMPTY, model).of(*kinds)


@pytest.mark.parametrize("kind", ["205", "R1-2", "B1"])
@pytest.mark.parametrize("orientation", ["+", "-"])
def test_teeth_of_a_give_way_line_point_at_who_waits(kind, orientation):
    model = street([lane(1), lane(-1)], [sign(kind, orientation)])
    found = quads(model, "teeth")
    y = found[..., 1]
    # Traffic along the road drives south of its middle, against it north of it; 3 m hold 4 teeth.
    assert len(found) == 4
    assert (np.sign(y) == (-1 if orientation == "+" else 1)).all()
    assert np.ptp(y) == pytest.approx(3 * 0.75 + 0.5)
    for tooth in found:
        ring = tooth[:3]
        assert shapely.Polygon(ring).area == pytest.approx(0.5 * 0.5 * 0.7)
        middle = np.median(ring[:, 0])  # two of three corners lie at the base
        tip = ring[np.argmax(np.abs(ring[:, 0] - middle)), 0]
        assert (tip < middle) == (orientation == "+")
        assert np.abs(middle - (60.0 if orientation == "+" else 0.0)) == pytest.approx(0.6)
    for one, other in itertools.combinations(found, 2):
        assert shapely.Polygon(one[:3]).intersection(shapely.Polygon(other[:3])).area < 1e-9


@pytest.mark.parametrize("orientation", ["+", "-"])
@pytest.mark.parametrize("s", [0.5, 10.0, 19.5])
def test_teeth_of_a_sign_within_a_junction_lie_at_the_mouth_of_the_street_before_it(orientation, s):
    """Two roads fork from one street and each has the sign: traffic waits once, before them."""
    one = street([lane(1, successor=7), lane(-1, successor=-1)]).roads[0]
    one = replace(one, successor=RoadLink("junction", 90))
    along = orientation == "+"
    ways = []
    for number, bend in ((2, 0.02), (3, -0.02)):
        x, heading = (60.0, 0.0) if along else (80.0, np.pi)
        curve = Curve((Piece(x, 0.0, heading, 20.0, bend),))
        inner = (
            SectionLane(-1, "driving", Profile.constant(3.0), True, predecessor=-1)
            if along
            else SectionLane(1, "driving", Profile.constant(3.0), False, successor=-1)
        )
        link = RoadLink("road", 1, "end")
        ends = {"predecessor": link} if along else {"successor": link}
        section = (LaneSection(0.0, (inner,)),)
        ways.append(
            ModelRoad(number, "", "", (), 90, curve, ZERO, ZERO, ZERO, ZERO, section, **ends)
        )
    signs = tuple(replace(sign("205", orientation), id=k, road=k, s=s) for k in (2, 3))
    model = LaneModel("right", (one, *ways), (ModelJunction(90, "", ()),), (), signs, ())
    found = quads(model, "teeth")
    assert len(found) == 4
    assert (found[..., 1] < 0).all()
    assert found[..., 0].max() == pytest.approx(59.4)


def test_a_sign_within_a_junction_that_no_street_leads_to_has_no_teeth():
    alone = replace(street([lane(-1)]).roads[0], junction=90)
    junction = ModelJunction(90, "", ())
    for link in (None, RoadLink("junction", 91), RoadLink("road", 1, "end")):
        road = replace(alone, predecessor=link)
        model = LaneModel("right", (road,), (junction,), (), (sign("205"),), ())
        assert len(quads(model, "teeth")) == 0


def test_other_signs_and_lanes_have_no_teeth():
    assert len(quads(street([lane(1), lane(-1)], [sign("206")]), "teeth")) == 0
    two = street([lane(-1), lane(-2)], [sign("205", lanes=(-2,))])
    assert (quads(two, "teeth")[..., 1] < -3.0).all()


@pytest.mark.parametrize(("width", "bay"), [(2.2, 6.0), (5.0, 2.5)])
def test_bays_divide_a_parking_lane_evenly(width, bay):
    model = street([lane(-1), lane(-2, "parking", width)])
    found = quads(model, "bay")
    x = np.sort(found[..., 0].mean(axis=1))
    np.testing.assert_allclose(np.diff(x), bay)
    assert 60 / bay - 1 <= len(found) <= 60 / bay + 1
    np.testing.assert_allclose(found[..., 1].min(axis=1), -3.0 - width)
    np.testing.assert_allclose(found[..., 1].max(axis=1), -3.0)
    np.testing.assert_allclose(np.ptp(found[..., 0], axis=1), 0.12)


def test_solid_and_broken_lines_have_their_length_and_width():
    """A solid edge, and 3 m dashes with 6 m between them on 60 m: 7 of them."""
    model = street([lane(-1, mark="broken"), lane(-2, mark="solid")])
    found = quads(model, "line")
    area = sum(shapely.Polygon(quad).area for quad in found)
    assert area == pytest.approx(0.15 * (60.0 + 7 * 3.0), rel=1e-6)
    assert set(np.round(found[..., 1].mean(axis=1), 6)) == {-3.0, -6.0}


def test_paint_knows_its_level_and_curbs_are_none():
    model = street([lane(-1, mark="curb"), lane(-2, mark="solid")], level=2)
    paint = painted(EMPTY, model)
    assert (paint.level == 2).all()
    assert {PAINT_KINDS[k] for k in paint.kind} == {"line"}
    assert (paint.quads[..., 1] < -5.9).all()
    assert len(painted(EMPTY).quads) == 0


@pytest.mark.parametrize(("level", "end"), [(0, 30.5), (1, 60.0)])
def test_no_line_lies_in_the_middle_of_another_roads_lane(level, end):
    """From 30 m on a lane of another street lies on the border of this one's."""
    centre = np.array([[30.0, -3.0, 0.0], [60.0, -3.0, 0.0]])
    other = Lane("b_0", "b", "driving", 4.0, 14.0, centre, np.zeros((0, 2)), level, (), (), "")
    network = RoadNetwork("right", (), (other,), (), (), ())
    found = painted(network, street([lane(1), lane(-1, mark="solid")])).of("line")
    border = found[np.abs(found[..., 1] + 3.0).max(axis=1) < 0.2]
    assert border[..., 0].min() == pytest.approx(0.0, abs=0.01)
    assert border[..., 0].max() == pytest.approx(end, abs=0.01)
