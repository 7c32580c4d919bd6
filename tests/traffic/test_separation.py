"""Nobody passes through anybody: the boxes by shapely, and how people would take it."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest
import shapely

from urbantwin.roads.network import Lane, Road, RoadNetwork
from urbantwin.traffic.paths.box_plan import PlanBoxes
from urbantwin.traffic.paths.footing import Footways
from urbantwin.traffic.paths.separation import Moving, separated

STEP_S = 0.1
SIZE = {"pedestrian": (0.9, 0.55), "car": (4.5, 1.8), "motorcycle": (2.0, 0.75)}
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
    footways: Footways | None = None,
    lane: int = 0,
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
    moving = Moving(number, boxes, speed, level, level + lane, kinds, np.arange(len(kinds)))
    known = footways or Footways(RoadNetwork("right", (), (), (), (), ()), [""])
    xy, _ = separated(moving, blocks, known, STEP_S)
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


@pytest.mark.parametrize("offset", [0.0, 0.1, -0.3])
def test_two_who_walk_into_each_other_pass_side_by_side(offset: float) -> None:
    before, after, shared = apart(
        [
            ("pedestrian", straight(0, 0, 0.0, 1.3), 1.3),
            ("pedestrian", straight(0, offset, np.pi, 1.4), 1.4),
        ]
    )
    assert shared < 0.01
    for old, new in zip(before, after, strict=True):
        assert np.abs(new - old).max() < 0.5  # each gives about half
        assert hardest(new) < 1.5  # as a person who sees the other come
        assert (np.diff(new @ (old[-1] - old[0])) > 0).all()  # and goes on
        np.testing.assert_allclose(new[[0, -1]], old[[0, -1]], atol=0.02)


def test_who_stands_is_passed_and_does_not_slide() -> None:
    _, (walker, stander), shared = apart(
        [
            ("pedestrian", straight(0, 0, 0.4, 1.2), 1.2),
            ("pedestrian", straight(0.05, 0, 2.0, 0.0), 0.0),
        ]
    )
    assert shared < 0.01
    assert np.ptp(stander, axis=0).max() < 0.01
    assert hardest(walker) < 2.0


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


def test_the_one_on_foot_gives_way_to_the_car() -> None:
    before, after, shared = apart(
        [("car", straight(0, 0, 0.0, 5.0), 5.0), ("pedestrian", straight(0, 0.9, 1.0, 0.0), 0.0)]
    )
    assert shared < 0.01
    assert np.abs(after[0] - before[0]).max() < 0.15
    assert after[1][0, 1] > 1.2


def test_people_walk_round_a_post_and_past_a_wall() -> None:
    post = PlanBoxes(np.zeros(1, int), np.array([[0.0, 0.05]]), np.zeros(1), np.full((1, 2), 0.1))
    wall = PlanBoxes(
        np.zeros(1, int), np.array([[0.0, -0.2]]), np.zeros(1), np.array([[10.0, 0.01]])
    )
    for block, least in ((post, 0.3), (wall, 0.05)):
        shape = block.polygons[0]
        before, (after,), _ = apart([("pedestrian", straight(0, 0, 0.0, 1.3), 1.3)], block)
        boxes = PlanBoxes(
            np.arange(len(after)), after, np.zeros(len(after)), np.tile([0.45, 0.275], (100, 1))
        )
        assert shapely.area(shapely.intersection(boxes.polygons, shape)).max() < 2e-3
        assert np.abs(after - before[0]).max() > least
        assert hardest(after) < 2.0


def test_who_is_pushed_aside_stays_on_the_footway() -> None:
    centre = np.array([[-20.0, 0.0, 0.0], [20.0, 0.0, 0.0]])
    street = np.array([[-20.0, 2.75, 0.0], [20.0, 2.75, 0.0]])
    none = np.zeros((0, 2))
    network = RoadNetwork(
        "right",
        (Road("r", "", (), "", ("r_0", "r_1"), "", ""),),
        (
            Lane("r_0", "r", "sidewalk", 2.0, 1.4, centre, none, 0, (), (), ""),
            Lane("r_1", "r", "driving", 3.5, 14.0, street, none, 0, (), (), ""),
        ),
        (),
        (),
        (),
    )
    footways = Footways(network, ["r_0", "r_1"], beyond_m=2.0)
    _, after, shared = apart(
        [
            ("pedestrian", straight(0, 0.65, 0.0, 1.3), 1.3),
            ("pedestrian", straight(0, 0.6, np.pi, 1.3), 1.3),
        ],
        footways=footways,
    )
    assert shared < 0.01
    assert max(path[:, 1].max() for path in after) < 0.8  # 0.2 m before the kerb, at the most
    assert min(path[:, 1].min() for path in after) < 0.3


def test_who_meets_nobody_keeps_the_path_to_the_bit() -> None:
    before, after, _ = apart(
        [
            ("pedestrian", straight(0, 0, 0.0, 1.3), 1.3),
            ("pedestrian", straight(0, 0, np.pi, 1.3), 1.3),
            ("pedestrian", straight(0, 30, 0.0, 1.3), 1.3),
            ("car", straight(0, -30, 0.0, 9.0), 9.0),
        ]
    )
    for number in (2, 3):
        np.testing.assert_array_equal(after[number], before[number])
    assert (after[0] != before[0]).any()
