"""Who comes late to a crossing waits there: for green, and for what comes."""

import numpy as np
import shapely

from urbantwin.traffic.paths.box_plan import PlanBoxes
from urbantwin.traffic.paths.crowd import Crossings, crowd_walked
from urbantwin.traffic.paths.separation import Moving
from urbantwin.traffic.paths.walked_ground import WalkedGround

STEP_S, COUNT, KERB_X, OVER_X = 0.1, 500, 4.0, 12.0
NOTHING = PlanBoxes(np.zeros(0, int), np.zeros((0, 2)), np.zeros(0), np.zeros((0, 2)))
SOLIDS: np.ndarray = np.array([], object)
FOOTWAY = shapely.box(-50, -50, 50, 50)
FOOTPATH, CROSSING, BEYOND = 0, 1, 2


def crossed(
    cars: list[np.ndarray], green: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where somebody at 1.3 m/s is among cars, x (COUNT,), its boxes, and its lanes."""
    x = np.minimum(-4.0 + 1.3 * STEP_S * np.arange(COUNT), 40.0)
    ways = [np.column_stack([x, np.zeros(COUNT)]), *cars]
    actor, step = np.repeat(np.arange(len(ways)), COUNT), np.tile(np.arange(COUNT), len(ways))
    lane = np.where(x <= KERB_X, FOOTPATH, np.where(x < OVER_X, CROSSING, BEYOND))
    xy = np.concatenate(ways)
    yaw = np.repeat([0.0] + [np.pi / 2] * len(cars), COUNT)
    half = np.repeat([[0.3, 0.25]] + [[2.2, 0.9]] * len(cars), COUNT, axis=0)
    speed = np.concatenate([np.hypot(*np.gradient(way, STEP_S, axis=0).T) for way in ways])
    columns = {
        "trip": actor,
        "step": step,
        "xy": xy,
        "yaw": yaw,
        "speed": speed,
        "distance": np.concatenate(
            [np.cumsum(speed[:COUNT]) * STEP_S, np.zeros(COUNT * len(cars))]
        ),
        "lane": np.concatenate([lane, np.full(COUNT * len(cars), BEYOND)]),
    }
    level = np.zeros(len(actor), int)
    kinds = ("pedestrian", *["car"] * len(cars))
    moving = Moving(
        actor, PlanBoxes(step, xy, yaw, half), speed, level, level, kinds, np.arange(len(ways))
    )
    light = np.array([-2, -1 if green is None else 0, -2])
    shown = np.zeros((0, COUNT), np.uint8) if green is None else green[None].astype(np.uint8)
    found = crowd_walked(
        columns, moving, half, STEP_S, WalkedGround(xy[:COUNT], NOTHING, SOLIDS, FOOTWAY),
        crossings=Crossings(light, shown),
    )  # fmt: skip
    shapes = PlanBoxes(step, found["xy"], found["yaw"], half).polygons.reshape(len(ways), COUNT)
    return found["xy"][:COUNT, 0], shapes, found["lane"][:COUNT]


def in_its_way_until(step: int) -> np.ndarray:
    """A car across the footpath that drives off."""
    y = np.where(np.arange(COUNT) < step, 0.0, 6.0 * STEP_S * (np.arange(COUNT) - step))
    return np.column_stack([np.zeros(COUNT), y])


def test_who_is_late_waits_for_the_next_green_and_who_is_not_goes_as_it_did() -> None:
    time = np.arange(COUNT)
    green = (time < 80) | ((time >= 250) & (time < 300))
    begins = 62  # at 1.3 m/s it comes to the kerb
    x, _, _ = crossed([], green)
    assert np.flatnonzero(x > KERB_X)[0] == begins
    x, _, lane = crossed([in_its_way_until(90)], green)
    assert 250 <= np.flatnonzero(x > KERB_X + 0.05)[0] <= 255
    assert green[np.flatnonzero(lane == CROSSING)[0]]
    assert x[200:250].min() > KERB_X - 0.1  # it stands at the kerb
    assert np.diff(x).max() / STEP_S < 2.25
    assert x[-1] > OVER_X + 10


def test_who_is_late_lets_a_car_by_that_comes_over_the_crossing() -> None:
    late = in_its_way_until(90)
    x, _, _ = crossed([late], None)
    free = int(np.flatnonzero(x > KERB_X + 0.05)[0])
    # It would be run over in the middle of the crossing.
    car = np.column_stack([np.full(COUNT, 8.0), 8.0 * STEP_S * (np.arange(COUNT) - free - 22)])
    x, shapes, _ = crossed([late, car], None)
    assert shapely.area(shapely.intersection(shapes[0], shapes[2])).max() == 0.0
    begins = int(np.flatnonzero(x > KERB_X + 0.05)[0])
    assert free + 10 < begins < free + 40
    assert x[begins + 1 :].min() > KERB_X  # and does not turn back


def test_where_the_next_crossing_begins() -> None:
    lane = np.array([0, 0, 1, 1, 2, 1, 1, 0, 1])
    joined = np.array([False, True, True, True, True, True, True, False, True])
    last = np.array([6] * 7 + [8] * 2)
    crossings = Crossings(np.array([-2, 0, -2]), np.ones((1, 9), np.uint8))
    found = crossings.kerbs(lane, joined, last, lambda rows: rows != 4)
    assert found[:, 0].tolist() == [2, 2, 2, 5, 5, 5, -1, 8, 8]
    assert found[[2, 5, 8], 1:].tolist() == [[3, 0, 1], [6, 0, 4], [8, 0, 7]]
