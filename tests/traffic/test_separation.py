"""Who drives goes round what stands beside: the boxes by shapely."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest
import shapely

from urbantwin.traffic.paths.box_plan import PlanBoxes
from urbantwin.traffic.paths.obstacles import Blocks
from urbantwin.traffic.paths.separation import Moving, separated

STEP_S = 0.1
SIZE = {"pedestrian": (0.9, 0.55), "car": (4.5, 1.8), "motorcycle": (2.0, 0.75), "bus": (12.0, 2.5)}
HEIGHT_M = {"pedestrian": 1.7, "car": 1.5, "motorcycle": 1.7, "bus": 3.2}
Path = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
NOTHING = PlanBoxes(np.zeros(0, int), np.zeros((0, 2)), np.zeros(0), np.zeros((0, 2)))


def straight(x: float, y: float, yaw: float, speed: float) -> Path:
    """At (x, y) after 5 s, on a straight line."""

    def at(time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        way = (time_s - 5.0) * speed
        place = np.column_stack([x + way * np.cos(yaw), y + way * np.sin(yaw)])
        return place, np.full(len(time_s), yaw)

    return at


def apart(
    actors: Sequence[tuple[str, Path, float]],
    blocks: PlanBoxes = NOTHING,
    begins_m: float = 0.0,
) -> tuple[list[np.ndarray], list[np.ndarray], float]:
    """Return the paths before and after, and the most that two boxes ever share."""
    time_s = np.arange(0.0, 10.0, STEP_S)
    count = len(time_s)
    poses = [path(time_s) for _, path, _ in actors]
    number = np.repeat(np.arange(len(actors)), count)
    half = np.array([SIZE[kind] for kind, _, _ in actors])[number] / 2
    boxes = PlanBoxes(
        np.tile(np.arange(count), len(actors)),
        np.concatenate([xy for xy, _ in poses]),
        np.concatenate([yaw for _, yaw in poses]),
        half,
    )
    speed = np.array([one for _, _, one in actors])[number]
    kinds = tuple(kind for kind, _, _ in actors)
    level = np.zeros(len(number), int)
    moving = Moving(number, boxes, speed, level, level, kinds, np.arange(len(kinds)))
    height = np.array([HEIGHT_M[kind] for kind in kinds])[number]
    stands = Blocks(blocks, np.full(len(blocks.yaw), begins_m))
    xy, _ = separated(moving, stands, height, STEP_S)
    shapes = PlanBoxes(boxes.step, xy, boxes.yaw, half).polygons.reshape(len(actors), count)
    shared = [
        shapely.area(shapely.intersection(shapes[a], shapes[b])).max()
        for a in range(len(actors))
        for b in range(a)
    ]
    before, after = (np.split(one, len(actors)) for one in (boxes.xy, xy))
    return before, after, max(shared, default=0.0)


def hardest(path: np.ndarray) -> float:
    """The greatest acceleration, m/s2."""
    return float(np.linalg.norm(np.diff(path, 2, axis=0), axis=1).max() / STEP_S**2)


def test_who_ride_beside_each_other_go_aside_and_who_cross_keep_to_their_ways() -> None:
    before, after, shared = apart(
        [
            ("motorcycle", straight(0, 0, 0.0, 6.0), 6.0),
            ("motorcycle", straight(0.5, 0.6, 0.0, 6.0), 6.0),
        ]
    )
    assert shared < 0.01
    assert max(np.abs(new - old).max() for old, new in zip(before, after, strict=True)) < 0.3
    before, after, _ = apart(
        [("car", straight(0, 0, 0.0, 6.0), 6.0), ("car", straight(0, 1.5, np.pi / 2, 6.0), 6.0)]
    )
    np.testing.assert_array_equal(before, after)


def test_who_rides_goes_round_somebody_who_has_no_room_and_a_bus_does_not() -> None:
    stands = ("pedestrian", straight(0, 0.55, 1.0, 0.0), 0.0)
    before, after, shared = apart([("motorcycle", straight(0, 0, 0.0, 5.0), 5.0), stands])
    assert shared < 0.01
    assert 0.05 < np.abs(after[0] - before[0]).max() < 0.5
    assert hardest(after[0]) < 2.0
    np.testing.assert_array_equal(after[1], before[1])
    before, after, _ = apart([("bus", straight(0, -0.8, 0.0, 5.0), 5.0), stands])
    np.testing.assert_array_equal(after, before)


@pytest.mark.parametrize(("kind", "meets"), [("bus", True), ("motorcycle", False)])
def test_what_hangs_over_the_street_is_in_the_way_of_who_is_so_high(kind: str, meets: bool) -> None:
    sign = PlanBoxes(np.zeros(1, int), np.array([[0.0, 1.3]]), np.zeros(1), np.full((1, 2), 0.2))
    before, (after,), _ = apart([(kind, straight(0, 0, 0.0, 6.0), 6.0)], sign, begins_m=2.3)
    aside = np.abs(after - before[0]).max()
    assert (aside > 0.1) == meets
    assert aside < 0.3


def test_who_meets_nobody_keeps_the_path_to_the_bit() -> None:
    before, after, _ = apart(
        [
            ("motorcycle", straight(0, 0, 0.0, 6.0), 6.0),
            ("motorcycle", straight(0.5, 0.6, 0.0, 6.0), 6.0),
            ("pedestrian", straight(0, 30, 0.0, 1.3), 1.3),
            ("car", straight(0, -30, 0.0, 9.0), 9.0),
        ]
    )
    for number in (2, 3):
        np.testing.assert_array_equal(after[number], before[number])
    assert (after[0] != before[0]).any()
