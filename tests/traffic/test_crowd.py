"""People step aside and wait, step by step: boxes by shapely, speeds by differences of places."""

from collections.abc import Sequence

import numpy as np
import pytest
import shapely

from urbantwin.traffic.paths import crowd
from urbantwin.traffic.paths.box_plan import PlanBoxes, near_pairs
from urbantwin.traffic.paths.crowd import crowd_walked
from urbantwin.traffic.paths.detours import round_blocks
from urbantwin.traffic.paths.obstacles import Outlines
from urbantwin.traffic.paths.separation import Moving
from urbantwin.traffic.paths.walked_ground import WalkedCells, WalkedGround

STEP_S = 0.1
HALF = {"pedestrian": (0.3, 0.25), "car": (2.2, 0.9)}
NOTHING = PlanBoxes(np.zeros(0, int), np.zeros((0, 2)), np.zeros(0), np.zeros((0, 2)))


def walked(
    ways: Sequence[np.ndarray],
    kinds: Sequence[str] | None = None,
    blocks: PlanBoxes = NOTHING,
    footway: shapely.Geometry | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return where actors (A, N) on ways are then (A, N, 2), and their boxes (A, N)."""
    kinds = kinds or ["pedestrian"] * len(ways)
    count = len(ways[0])
    actor = np.repeat(np.arange(len(ways)), count)
    step = np.tile(np.arange(count), len(ways))
    velocity = np.concatenate([np.gradient(way, STEP_S, axis=0) for way in ways])
    courses = [np.diff(way, axis=0)[np.hypot(*np.diff(way, axis=0).T) > 1e-9] for way in ways]
    yaw = np.concatenate([np.full(count, np.arctan2(*one[0][::-1])) for one in courses])
    half = np.array([HALF[kind] for kind in kinds])[actor]
    columns = {
        "trip": actor,
        "step": step,
        "xy": np.concatenate(ways),
        "yaw": yaw,
        "speed": np.hypot(*velocity.T),
        "distance": np.zeros(len(actor)),
        "lane": np.zeros(len(actor), int),
    }
    level = np.zeros(len(actor), int)
    boxes = PlanBoxes(step, columns["xy"], yaw, half)
    moving = Moving(
        actor, boxes, columns["speed"], level, level, tuple(kinds), np.arange(len(ways))
    )
    footway = footway or shapely.box(-50, -50, 50, 50)
    solids: np.ndarray = np.array([], object)
    afoot = columns["xy"][np.array(kinds)[actor] == "pedestrian"]
    ground = WalkedGround(afoot, blocks, solids, footway)
    found = crowd_walked(columns, moving, half, STEP_S, ground)
    shapes = PlanBoxes(step, found["xy"], found["yaw"], half).polygons.reshape(len(ways), count)
    return found["xy"].reshape(len(ways), count, 2), shapes


def straight(start: Sequence[float], end: Sequence[float], count: int = 120) -> np.ndarray:
    return np.linspace(start, end, count)


def most_shared(shapes: np.ndarray) -> float:
    return max(
        shapely.area(shapely.intersection(shapes[a], shapes[b])).max()
        for a in range(len(shapes))
        for b in range(a)
    )


def fastest(places: np.ndarray) -> float:
    return float(np.hypot(*np.moveaxis(np.diff(places, axis=1), 2, 0)).max() / STEP_S)


def test_two_who_walk_into_each_other_pass_and_come_back_to_their_ways() -> None:
    ways = [straight([-8, 0], [8, 0]), straight([8, 0], [-8, 0])]
    places, shapes = walked(ways)
    assert most_shared(shapes) < 0.02
    assert fastest(places) < 2.4
    aside = places[:, :, 1]
    assert aside[0].min() < -0.15  # both keep to their right
    assert aside[1].max() > 0.15
    assert np.abs(places - np.array(ways)).max() < 1.0
    assert np.abs(places[:, -1] - np.array(ways)[:, -1]).max() < 0.15


def test_people_walk_the_same_however_often_progress_is_reported(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ways = [straight([-8, 0], [8, 0]), straight([8, 0], [-8, 0]), straight([0, -8], [0, 8])]
    found = []
    for steps in (1, 7, 1000):
        monkeypatch.setattr(crowd, "_AT_ONCE", steps)
        found.append(walked(ways)[0])
    np.testing.assert_array_equal(found[0], found[1])
    np.testing.assert_array_equal(found[0], found[2])


def test_who_comes_into_nobody_keeps_the_way_to_the_bit() -> None:
    ways = [straight([-8, 2.0 * k], [8, 2.0 * k]) for k in range(3)]
    places, _ = walked(ways)
    np.testing.assert_array_equal(places, np.array(ways))


def test_a_crowd_that_stops_at_one_place_stands_side_by_side() -> None:
    ways = []
    for k in range(8):
        angle, stops = 0.8 * k, 50 + 6 * k
        start = 7 * np.array([np.cos(angle), np.sin(angle)])
        arrives = straight(start, np.zeros(2), stops)
        ways.append(np.concatenate([arrives, np.zeros((160 - stops, 2))]))
    places, shapes = walked(ways)
    assert most_shared(shapes) < 0.005
    assert np.abs(np.diff(places[:, 140:], axis=1)).max() < 0.02  # who stands does not slide


def test_two_crowds_on_a_narrow_way_pass_through_each_other_one_by_one() -> None:
    rng = np.random.default_rng(5)
    ways = []
    for k in range(16):
        y, side = rng.uniform(-1.0, 1.0), 1 if k % 2 else -1
        start = side * (6.0 + 1.1 * (k // 2))
        walks = straight([start, y], [-start, y], 240)
        ways.append(np.concatenate([walks, np.tile(walks[-1:], (160, 1))]))
    places, shapes = walked(ways, footway=shapely.box(-50, -1.5, 50, 1.5))
    assert most_shared(shapes) < 0.005
    assert fastest(places) < 2.4
    # Who walks on waits: in the end all are where they would be.
    assert np.abs(places[:, -1] - np.array(ways)[:, -1]).max() < 2.0


def test_who_is_held_up_walks_on_later_and_makes_up_for_it() -> None:
    way = straight([-8, 0], [8, 0], 200)
    car = np.concatenate([np.zeros((120, 2)), straight([0.0, 0.0], [0.0, 40.0], 80)])
    places, shapes = walked([way, car + [0.0, 0.05]], ["pedestrian", "car"])
    assert most_shared(shapes) < 0.005
    assert fastest(places[:1]) < 2.4
    late = way[:, 0] - places[0, :, 0]
    assert late.max() > 1.0
    assert late.min() > -0.6
    assert late[-1] < late.max() - 0.5


def test_nobody_on_foot_is_faster_than_people_run() -> None:
    speed = np.where((np.arange(100) > 30) & (np.arange(100) < 40), 5.0, 1.3)
    at = np.cumsum(speed) * STEP_S
    places, _ = walked([np.column_stack([at, np.zeros(100)])])
    assert fastest(places) < 2.4


def test_people_walk_past_a_post_and_cars_do_not_give_way() -> None:
    post = PlanBoxes(np.zeros(1, int), np.zeros((1, 2)), np.zeros(1), np.full((1, 2), 0.1))
    car = straight([-14, 5.0], [16, 5.0])
    ways = [straight([-8, 0.05], [8, 0.05]), car, straight([-8, 5.9], [8, 5.9])]
    places, shapes = walked(ways, ["pedestrian", "car", "pedestrian"], post)
    assert shapely.area(shapely.intersection(shapes[0], post.polygons[0])).max() == 0.0
    np.testing.assert_array_equal(places[1], car)
    assert shapely.area(shapely.intersection(shapes[1], shapes[2])).max() < 0.05


def test_nobody_steps_off_the_footway() -> None:
    ways = [straight([-8, 0], [8, 0]), straight([8, 0], [-8, 0])]
    places, _ = walked(ways, footway=shapely.box(-50, -0.1, 50, 10))
    assert places[:, :, 1].min() > -0.31  # a cell beside it


def test_what_comes_later_changes_nothing_more_than_two_seconds_before() -> None:
    alone = straight([-8, 0], [8, 0])
    comes = straight([8, 0.1], [-8, 0.1])
    far = comes + np.array([0.0, 30.0])
    meets, misses = walked([alone, comes])[0][0], walked([alone, far])[0][0]
    first = int(np.flatnonzero((meets != misses).any(axis=1))[0])
    assert first > 56 - 21  # they would touch at the 57th step
    np.testing.assert_array_equal(misses, alone)


def test_who_is_near_whom_is_as_counted_one_by_one() -> None:
    rng = np.random.default_rng(3)
    count = 300
    boxes = PlanBoxes(
        rng.integers(0, 6, count),
        rng.uniform(0, 40, (count, 2)),
        np.zeros(count),
        rng.uniform(0.2, 3.0, (count, 2)),
    )
    reach = np.hypot(*boxes.half.T)
    far = np.hypot(*np.moveaxis(boxes.xy[:, None] - boxes.xy, 2, 0))
    near = (far < reach[:, None] + reach + 0.5) & (boxes.step[:, None] == boxes.step)
    np.testing.assert_array_equal(near_pairs(boxes, 0.5), np.argwhere(np.triu(near, 1)))
    wanted = rng.random(count) < 0.2
    some = np.triu(near & (wanted[:, None] | wanted), 1)
    np.testing.assert_array_equal(near_pairs(boxes, 0.5, wanted), np.argwhere(some))


def test_no_row_near_a_shape_is_passed_over() -> None:
    rng = np.random.default_rng(4)
    points = rng.uniform(-60, 60, (2000, 2))
    reach = rng.uniform(0.1, 5.0, 2000)
    shapes = shapely.box(*(corner := rng.uniform(-50, 50, (12, 2))).T, *(corner + 3.0).T)
    outlines = Outlines(shapes)
    away = shapely.distance(shapely.points(points)[:, None], shapes).min(axis=1)
    for rows in (np.arange(0, 2000, 2), np.arange(500), np.arange(2000)):  # some asked for again
        found = rows[outlines.near(points[rows], reach[rows])]
        assert set(rows[away[rows] <= reach[rows]]) <= set(found)
        assert (away[found] <= reach[found] + 2.0).all()


def test_the_way_round_a_wall_is_the_shortest_and_none_leads_out_of_a_court() -> None:
    wall = shapely.box(-0.2, -3.0, 0.2, 30.0)
    court = shapely.box(-6, -6, 6, 6).difference(shapely.box(-5, -5, 5, 5))
    points, everywhere = np.array([[-12.0, -12.0], [12.0, 12.0]]), shapely.box(-50, -50, 50, 50)
    start, end = np.array([-2.0, 0.0]), np.array([2.0, 0.0])
    found = WalkedCells(points, np.array([wall], object), everywhere, 10.0).way(start, end)
    assert found is not None
    length = np.hypot(*np.diff(found, axis=0).T).sum()
    shortest = 2 * np.hypot(1.8, 3.0) + 0.4  # round both corners
    assert shortest - 0.8 < length < 1.09 * shortest  # ways lead to eight neighbours
    assert not shapely.intersects_xy(wall.buffer(-0.15), *found.T).any()  # a corner is levelled
    outside = np.array([9.0, 0.0])
    closed = WalkedCells(points, np.array([court], object), everywhere, 10.0)
    assert closed.way(start, outside) is None


def test_a_way_through_a_court_leads_round_it() -> None:
    court = shapely.box(-3, -3, 3, 3).difference(shapely.box(-2.4, -2.4, 2.4, 2.4))
    way = straight([-9.0, 2.0], [9.0, 2.0], 140)
    columns = {
        "trip": np.zeros(140, int),
        "step": np.arange(140),
        "xy": way,
        "yaw": np.zeros(140),
        "distance": way[:, 0] + 9.0,
        "speed": np.full(140, 18.0 / 13.9),
    }
    cells = WalkedCells(way, np.array([court], object), shapely.box(-50, -50, 50, 50), 10.0)
    found = round_blocks(columns, np.ones(140, bool), cells, STEP_S)["xy"]
    # It cuts the corner by less than the room that outlines leave.
    assert not shapely.contains_xy(shapely.box(-2.8, -2.8, 2.8, 2.8), *found.T).any()
    assert 2.8 < found[:, 1].max() < 3.6
    np.testing.assert_array_equal(found[[0, -1]], way[[0, -1]])
