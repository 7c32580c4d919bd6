"""Curbs moved to lines, against closed forms on streets that are straight, curved and cut."""

import itertools

import numpy as np
import pytest
import shapely

from urbantwin.roads.model import (
    Curve,
    LaneModel,
    LaneSection,
    ModelRoad,
    Piece,
    Profile,
    RoadLink,
    SectionLane,
)
from urbantwin.roads.side_lanes import with_moved_curbs

ZERO = Profile.constant(0.0)
RAISED = {"sidewalk": 0.15, "curb": 0.15, "median": 0.15}


def road(rows, number=1, *, length=80.0, curvature=0.0, x=0.0, **links):
    lanes = tuple(
        SectionLane(
            i,
            kind,
            Profile.constant(width),
            i < 0,
            strip=f"{number}_{i}",
            height=RAISED.get(kind, 0),
        )
        for i, kind, width in sorted(rows, reverse=True)
    )  # fmt: skip
    return ModelRoad(
        number, "", "residential", (number,), -1, Curve((Piece(x, 0.0, 0.0, length, curvature),)),
        ZERO, ZERO, ZERO, ZERO, (LaneSection(0.0, lanes),), **links,
    )  # fmt: skip


BOTH_WAYS = [(2, "curb", 0.15), (1, "driving", 3.0), (-1, "driving", 3.0), (-2, "curb", 0.15),
             (-3, "sidewalk", 2.0)]  # fmt: skip


def beside(one, t, first=20.0, last=60.0):
    """A line at an offset to the left of a road."""
    s = np.linspace(first, last, 30)
    return shapely.LineString(one.curve.beside(s, np.full(30, t)))


def curb_at(one, side, s):
    """Where the curb's face is: the inner border of the first raised lane of a side."""
    section = one.section_at(s)
    lanes = sorted((x for x in section.lanes if x.id * side > 0), key=lambda x: abs(x.id))
    raised = next(x for x in lanes if x.kind in RAISED)
    return float(one.border(section, raised, s, outer=False)[0])


def moved(one, *lines):
    model, told = with_moved_curbs(LaneModel("right", (one,)), dict(enumerate([list(lines)])))
    return model.roads[0], told[0]


@pytest.mark.parametrize("curvature", [0.0, 0.01, -0.008])
@pytest.mark.parametrize("by", [-0.8, -0.2, 0.3, 0.7, 1.6, 3.0])
def test_the_curb_is_on_the_line_and_elsewhere_where_it_was(curvature, by):
    before = road(BOTH_WAYS, curvature=curvature)
    after, told = moved(before, beside(before, -3.0 - by))
    for s in np.linspace(20, 60, 33):
        assert curb_at(after, -1, s) == pytest.approx(-3.0 - by, abs=0.01)
        assert curb_at(after, 1, s) == pytest.approx(3.0, abs=1e-6)
    for s in (0.0, 5.0, 75.0, 80.0):
        assert curb_at(after, -1, s) == pytest.approx(-3.0, abs=0.01)
    assert told.metres == pytest.approx(40.0, abs=0.3)
    assert told.farthest_m == pytest.approx(abs(by), abs=0.01)
    # The sidewalk behind it is as wide as it was.
    for section in after.sections:
        walk = section.by_id[min(section.by_id)]
        assert walk.kind == "sidewalk"
        assert walk.width.at([0.0, 1.0]) == pytest.approx(2.0)


def test_wide_moves_give_a_shoulder_and_small_ones_a_wider_lane():
    before = road(BOTH_WAYS)
    wide, _ = moved(before, beside(before, -5.0))
    assert [x.kind for x in wide.section_at(40).lanes].count("shoulder") == 1
    small, _ = moved(before, beside(before, -3.5))
    assert [x.kind for x in small.section_at(40).lanes] == [
        x.kind for x in before.sections[0].lanes
    ]


def test_parking_gives_up_its_width_before_traffic_does():
    rows = [*BOTH_WAYS[:3], (-2, "parking", 2.0), (-3, "curb", 0.15), (-4, "sidewalk", 2.0)]
    before = road(rows)
    after, _ = moved(before, beside(before, -2.6))
    width = {x.kind: float(x.width.at(40.0)[0]) for x in after.sections[0].lanes if x.id < 0}
    assert width["parking"] == pytest.approx(0.0, abs=0.005)
    assert width["driving"] == pytest.approx(2.6, abs=0.005)


def test_what_would_leave_no_lane_is_not_done():
    before = road(BOTH_WAYS)
    after, told = moved(before, beside(before, -1.5))
    assert after is before
    assert told.metres == 0
    assert "0.50 m too narrow" in told.why_not[0]


def test_lines_elsewhere_move_nothing():
    before = road(BOTH_WAYS)
    after, told = moved(before, beside(before, -14.0))
    assert after is before
    assert told.nearest_m == pytest.approx(11.0, abs=0.01)
    across = shapely.LineString([(40, -8), (40, 8)])
    assert moved(before, across)[0] is before


@pytest.mark.parametrize("by", [-0.6, 0.9])
def test_the_curb_of_a_median(by):
    rows = [(1, "median", 2.0), (-1, "driving", 3.5), (-2, "driving", 3.0), (-3, "curb", 0.15)]
    before = road(rows)
    after, _ = moved(before, beside(before, by))
    section = after.section_at(40)
    assert curb_at(after, 1, 40.0) == pytest.approx(by, abs=0.01)
    assert curb_at(after, -1, 40.0) == pytest.approx(-6.5, abs=0.01)
    assert float(after.border(section, section.by_id[1], 40.0, outer=True)[0]) == pytest.approx(
        2.0, abs=0.01
    )
    assert float(section.by_id[-1].width.at(40.0 - section.s)[0]) == pytest.approx(
        3.5 + by, abs=0.01
    )


def test_a_line_over_the_end_of_a_road_goes_on_along_the_next():
    first = road(BOTH_WAYS, 1, successor=RoadLink("road", 2, "start"))
    second = road(BOTH_WAYS, 2, x=80.0, predecessor=RoadLink("road", 1, "end"))
    line = shapely.LineString([(60, -4.0), (100, -4.0)])
    model, told = with_moved_curbs(LaneModel("right", (first, second)), {7: [line]})
    for one, stations in zip(model.roads, ([60, 70, 79, 80], [0, 1, 10, 20]), strict=True):
        for s in stations:
            assert curb_at(one, -1, float(s)) == pytest.approx(-4.0, abs=0.01)
    assert told[7].metres == pytest.approx(40, abs=0.6)
    # Before a junction there is room to go back: the line ends there.
    alone = road(BOTH_WAYS, 1)
    after, _ = moved(alone, shapely.LineString([(60, -4.0), (100, -4.0)]))
    assert curb_at(after, -1, 80.0) == pytest.approx(-3.0, abs=0.01)


def test_both_sides_of_one_street():
    before = road(BOTH_WAYS)
    after, _ = moved(before, beside(before, -4.2), beside(before, 4.4), beside(before, 2.5, 62, 70))
    assert curb_at(after, -1, 40.0) == pytest.approx(-4.2, abs=0.01)
    assert curb_at(after, 1, 40.0) == pytest.approx(4.4, abs=0.01)
    assert curb_at(after, 1, 66.0) == pytest.approx(2.5, abs=0.01)
    for a, b in itertools.pairwise(after.sections):
        for lane in b.lanes:  # lanes go on where they are said to
            if lane.predecessor is not None:
                assert a.by_id[lane.predecessor].kind == lane.kind
