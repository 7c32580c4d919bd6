"""Symbols of plans: turn arrows, the lines of roads, turns that lanes may take."""

import dataclasses
import itertools

import numpy as np
import pytest
import shapely
from shapely.affinity import scale

from urbantwin.drawing.markings import markings
from urbantwin.drawing.road_furniture import islands, signs
from urbantwin.geometry import LabelledMesh
from urbantwin.roads import Lane, RoadNetwork
from urbantwin.roads.marking import arrow, lane_marks, stop_lines, turns
from urbantwin.roads.model import (
    Curve,
    LaneModel,
    LaneSection,
    ModelRoad,
    Piece,
    Profile,
    RoadArea,
    RoadSignal,
    SectionLane,
)
from urbantwin.taxonomy import material_id, semantic_id

WAYS = ("left", "through", "right", "around")
ZERO = Profile.constant(0.0)


@pytest.mark.parametrize(
    "ways", [w for n in (1, 2, 3) for w in itertools.combinations(WAYS, n)], ids="-".join
)
def test_an_arrow_is_one_shape_that_fits_a_lane(ways):
    shape = arrow(ways)
    assert shape.geom_type == "Polygon"
    x0, y0, x1, y1 = shape.bounds
    assert x0 == pytest.approx(-1.0)  # the tail
    assert x1 == pytest.approx(0.0, abs=0.4)
    assert 6.0 * (y1 - y0) < (3.2 if len(ways) < 3 else 3.5)  # drawn 6 m long, within a lane
    assert y0 + y1 == pytest.approx(0.0, abs=1e-9)


def test_left_is_the_mirror_of_right():
    left, right = arrow(("left",)), arrow(("right",))
    assert scale(left, 1, -1, origin=(0, 0)).symmetric_difference(right).area < 1e-9
    # The head, which is the widest part of it, is on its own side.
    tip = max(left.exterior.coords, key=lambda corner: corner[1])
    tail = [corner for corner in left.exterior.coords if corner[0] < -0.9]
    assert tip[1] > max(y for _, y in tail)


def turning(headings):
    """A lane to the east into a junction, from which lanes lead out at headings (degrees)."""

    def lane(name, start, end, successors, junction=""):
        centre = np.array([[*start, 0.0], [*end, 0.0]])
        kind = "connection" if junction else "driving"
        empty = np.zeros((0, 2))
        return Lane(name, "", kind, 3.0, 14.0, centre, empty, 0, ("car",), successors, junction)

    lanes = [lane("in", (-20, 0), (0, 0), tuple(f":{k}" for k in range(len(headings))))]
    for k, heading in enumerate(np.radians(headings)):
        way = np.array([np.cos(heading), np.sin(heading)])
        half = 5 * np.array([np.cos(heading / 2), np.sin(heading / 2)])
        # In two pieces: the first alone does not tell where it leads.
        lanes.append(lane(f":{k}", (0, 0), half, (f":{k}b",), "j"))
        lanes.append(lane(f":{k}b", half, half + 5 * way, (f"out{k}",), "j"))
        lanes.append(lane(f"out{k}", half + 5 * way, half + 25 * way, ()))
    return RoadNetwork("right", (), tuple(lanes), (), (), ())


@pytest.mark.parametrize(
    ("headings", "expected"),
    [
        ([0], ("through",)),
        ([90, 0, -90], ("left", "through", "right")),
        ([-20], ("through",)),
        ([50, -179], ("left", "around")),
        ([], ()),
    ],
)
def test_turns_are_told_by_where_lanes_leave_the_junction(headings, expected):
    network = turning(headings)
    assert turns(network, network.lane_by_id["in"]) == expected


@pytest.fixture
def model():
    """A road to the north, 100 m, from (10, 20): a lane each way, a walk, a broken centre line."""
    heading = np.pi / 2
    lanes = (
        SectionLane(1, "driving", Profile.constant(3.0), False, mark="solid", strip="b"),
        SectionLane(-1, "driving", Profile.constant(3.0), True, mark="curb", strip="a"),
        SectionLane(-2, "sidewalk", Profile.constant(2.0), True, mark="none", strip="s"),
    )
    road = ModelRoad(
        1, "North Street", "residential", (), -1,
        Curve((Piece(10.0, 20.0, heading, 100.0),)), ZERO, ZERO, ZERO, ZERO,
        (LaneSection(0.0, lanes, "broken"),),
    )  # fmt: skip
    bar = np.array([[-0.2, -3.0, 0], [0.2, -3.0, 0], [0.2, 0.0, 0], [-0.2, 0.0, 0]])
    square = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
    areas = (
        RoadArea(2, 1, "roadMark", "StopLine", 98.0, bar, strip="a"),
        RoadArea(3, 1, "trafficIsland", "island", 50.0, square, height=0.15),
    )
    limit = RoadSignal(
        4, 1, "limit", False, "DE", "274", "50", 50.0, "km/h", 10.0, -4.0, 2.0, "+"
    )  # fmt: skip
    facing = RoadSignal(5, 1, "lamp", True, "OpenDRIVE", "1000001", "-1", np.nan, "", 5, 4, 5, "-")
    return LaneModel("right", (road,), (), areas, (limit, facing))


def test_lines_lie_where_the_model_s_borders_are(model):
    network = RoadNetwork("right", (), (), (), (), ())
    found = {(line.kind, line.lane): line.points for line in lane_marks(network, model)}
    assert set(found) == {("broken", ""), ("solid", "b"), ("curb", "a")}
    # To the north, left is west: x = 10 - t.
    for key, x in ((("broken", ""), 10.0), (("solid", "b"), 7.0), (("curb", "a"), 13.0)):
        np.testing.assert_allclose(found[key][[0, -1]], [[x, 20.0], [x, 120.0]], atol=1e-9)


def test_areas_and_signs_are_placed_in_the_site_frame(model):
    network = RoadNetwork("right", (), (), (), (), ())
    (stop,) = stop_lines(network, model)
    np.testing.assert_allclose(np.sort(stop.points[:, 0]), [10.0, 13.0], atol=1e-6)
    np.testing.assert_allclose(stop.points[:, 1], 118.0, atol=1e-6)
    ((kind, island),) = islands(network, model)
    assert kind == "island"
    assert (
        island.equals(shapely.box(9, 69, 11, 71))
        or island.symmetric_difference(shapely.box(9, 69, 11, 71)).area < 1e-6
    )
    (sign,) = signs(model)  # the lamp changes: it is none
    assert (sign.x, sign.y) == pytest.approx((14.0, 30.0))
    assert sign.yaw == pytest.approx(np.pi / 2)
    assert sign.value == 50.0
    assert sign.plate == "disc"
    # MUTCD R2-1 is a white rectangle; the Vienna Convention's limits are discs.
    limit = dataclasses.replace(model.signals[0], country="US", type="R2-1", subtype="-1")
    (american,) = signs(dataclasses.replace(model, signals=(limit,)))
    assert american.plate == "upright"


def test_paint_has_the_area_of_the_model_s_marks(model):
    centre = np.array([[11.5, 20.0, 0.0], [11.5, 120.0, 0.0]])
    none = np.zeros((0, 2))
    lane = Lane("a", "r", "driving", 3.0, 14.0, centre, none, 0, ("car",), (), "")
    network = RoadNetwork("right", (), (lane,), (), (), ())
    corners = np.array([[-200, -200, 0], [200, -200, 0], [200, 200, 0], [-200, 200, 0]])
    flat = LabelledMesh.build(
        corners, [[0, 1, 2], [0, 2, 3]], semantic_id("road"), material_id("asphalt")
    )
    paint = markings(network, flat, model)
    dashes = (100 + 6) // (3 + 6)  # three metres, six of gap
    expected = 0.15 * (3.0 * dashes + 100.0) + 0.4 * 3.0  # and the stop line across the lane
    assert paint.areas().sum() == pytest.approx(expected, rel=1e-6)
    assert (paint.normals()[:, 2] > 0.99).all()
