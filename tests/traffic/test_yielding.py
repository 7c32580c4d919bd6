"""Who would pass through somebody waits: the boxes by shapely, speeds by differences of places."""

from collections.abc import Sequence

import numpy as np
import pytest
import shapely

from urbantwin.traffic.paths.box_plan import PlanBoxes
from urbantwin.traffic.paths.separation import Moving
from urbantwin.traffic.paths.yielding import yielded

STEP_S = 0.1
SIZE = {"pedestrian": (0.7, 0.5), "car": (4.5, 1.8), "bus": (12.0, 2.5), "tram": (12.0, 2.4)}
#: The greatest accelerations that the text books allow, m/s2.
BRAKES = {"car": 8.0, "bus": 6.5, "pedestrian": 4.0}


def way(place: np.ndarray, speed: np.ndarray, yaw: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Straight on from a place at speeds: places (N, 2) and headings (N,)."""
    went = np.concatenate([[0.0], np.cumsum(speed[1:]) * STEP_S])
    ahead = np.array([np.cos(yaw), np.sin(yaw)])
    return place + went[:, None] * ahead, np.full(len(speed), yaw)


def waited(
    actors: Sequence[tuple[str, np.ndarray, np.ndarray]], leaders: Sequence[int] | None = None
) -> tuple[dict[str, np.ndarray], float]:
    """Return the columns after, and the most that two boxes ever share."""
    count = len(actors[0][2])
    number = np.repeat(np.arange(len(actors)), count)
    step = np.tile(np.arange(count), len(actors))
    half = np.array([SIZE[kind] for kind, _, _ in actors])[number] / 2
    xy, yaw = (np.concatenate([one[k] for one in actors]) for k in (1, 2))
    went = [np.hypot(*np.diff(places, axis=0).T) for _, places, _ in actors]
    columns = {
        "trip": number,
        "step": step,
        "xy": xy,
        "yaw": yaw,
        "speed": np.concatenate([np.append(one, one[-1]) / STEP_S for one in went]),
        "distance": np.concatenate([np.append(0.0, np.cumsum(one)) for one in went]),
        "lane": np.zeros(len(step), int),
    }
    level = np.zeros(len(step), int)
    kinds = tuple(kind for kind, _, _ in actors)
    boxes = PlanBoxes(step, xy, yaw, half)
    vehicles = np.array(leaders or range(len(actors)))
    moving = Moving(number, boxes, columns["speed"], level, level, kinds, vehicles)
    found = yielded(columns, moving, half, STEP_S)
    shapes = PlanBoxes(step, found["xy"], found["yaw"], half).polygons.reshape(-1, count)
    shared = [
        shapely.area(shapely.intersection(shapes[a], shapes[b])).max()
        for a in range(len(actors))
        for b in range(a)
    ]
    return found, max(shared, default=0.0)


def hardest(found: dict[str, np.ndarray], actor: int) -> tuple[float, float]:
    """The strongest braking and starting of an actor, by its places over 0.5 s, m/s2."""
    place = found["xy"][found["trip"] == actor]
    speed = np.hypot(*np.diff(place, axis=0).T) / STEP_S
    gained = (speed[5:] - speed[:-5]) / (5 * STEP_S)
    return float(-gained.min()), float(gained.max())


def test_of_two_cars_that_cross_one_waits_and_keeps_to_its_way() -> None:
    fast = np.full(150, 6.0)
    east, north = way(np.array([-30.0, 0.0]), fast), way(np.array([0.0, -31.0]), fast, np.pi / 2)
    found, shared = waited([("car", *east), ("car", *north)])
    assert shared == 0.0
    first, second = (found["xy"][found["trip"] == k] for k in (0, 1))
    np.testing.assert_array_equal(first, east[0])  # who is there first goes first, to the bit
    assert np.abs(second[:, 0]).max() < 1e-9
    late = north[0][:, 1] - second[:, 1]
    assert late.min() > -1e-9
    assert late.max() > 1.0
    brakes, starts = hardest(found, 1)
    assert brakes < 3.5  # it has time
    assert starts < 3.2
    told = found["speed"][found["trip"] == 1]
    np.testing.assert_allclose(told[1:-1], np.gradient(second[:, 1], STEP_S)[1:-1], atol=0.2)


@pytest.mark.parametrize("kind", ["car", "bus"])
def test_who_stops_harder_than_it_can_begins_earlier(kind: str) -> None:
    speed = np.where(np.arange(120) < 60, 12.0, 0.0)  # a wall would stop it like that
    found, _ = waited([(kind, *way(np.zeros(2), speed))])
    assert hardest(found, 0)[0] < BRAKES[kind]
    before = way(np.zeros(2), speed)[0]
    assert (found["xy"][:, 0] <= before[:, 0] + 1e-9).all()
    np.testing.assert_allclose(found["xy"][-1], before[-1], atol=0.1)


def test_who_comes_behind_waits_in_its_turn() -> None:
    fast, still = np.full(200, 5.0), np.zeros(200)
    queue = [("car", *way(np.array([-20.0 - 6.0 * n, 0.0]), fast)) for n in range(3)]
    crossing = ("tram", *way(np.array([0.0, -32.0]), fast + still, np.pi / 2))
    found, shared = waited([*queue, crossing])
    assert shared == 0.0
    assert all(hardest(found, n)[0] < BRAKES["car"] for n in range(3))
    np.testing.assert_array_equal(found["xy"][found["trip"] == 3], crossing[1])  # rails


def test_a_curve_is_taken_no_faster_than_wheels_hold() -> None:
    radius, speed = 12.0, 9.0
    angle = np.concatenate([np.zeros(30), np.arange(60) * STEP_S * speed / radius])
    straight = np.concatenate([np.arange(-30, 0), np.zeros(60)]) * STEP_S * speed
    places = np.column_stack([straight + radius * np.sin(angle), radius * (1 - np.cos(angle))])
    found, _ = waited([("car", places, angle)])
    turned = np.gradient(found["yaw"], STEP_S)
    went = np.hypot(*np.gradient(found["xy"], STEP_S, axis=0).T)
    assert (np.abs(turned) * went)[40:].max() < 4.0 < speed**2 / radius


def test_what_is_drawn_stays_behind_who_draws_it() -> None:
    fast = np.full(150, 6.0)
    places, yaw = way(np.array([-30.0, 0.0]), fast)
    towed = places - [9.0, 0.0]
    across = way(np.array([0.0, -22.0]), fast, np.pi / 2)
    found, shared = waited(
        [("tram", *across), ("car", places, yaw), ("car", towed, yaw)], (0, 1, 1)
    )
    assert shared == 0.0
    head, behind = (found["xy"][found["trip"] == k] for k in (1, 2))
    np.testing.assert_allclose(head - behind, places - towed, atol=1e-9)
    assert (head[:, 0] < places[:, 0] - 0.5).any()


def test_who_meets_nobody_keeps_the_way_to_the_bit() -> None:
    fast = np.full(100, 6.0)
    ways = [way(np.array([0.0, 10.0 * n]), fast) for n in range(3)]
    found, _ = waited([("car", *one) for one in ways])
    np.testing.assert_array_equal(found["xy"], np.concatenate([one[0] for one in ways]))


def test_a_later_meeting_changes_nothing_of_an_earlier_one() -> None:
    east = way(np.array([-30.0, 0.0]), np.full(2400, 6.0))
    north = way(np.array([0.0, -31.0]), np.full(2400, 6.0), np.pi / 2)
    # A third comes over the way of the first at x = 1,170 m, where that one is after 200 s.
    south = way(np.array([1170.0, 1200.5]), np.full(2400, 6.0), -np.pi / 2)
    both, _ = waited([("car", *east), ("car", *north)])
    three, shared = waited([("car", *east), ("car", *north), ("car", *south)])
    assert shared == 0.0
    for k in (0, 1):
        early = (three["trip"] == k) & (three["step"] < 1500)
        np.testing.assert_array_equal(
            three["xy"][early], both["xy"][both["step"] < 1500][k * 1500 : (k + 1) * 1500]
        )
    assert three["behind"][three["step"] > 1900].max() > 1.0
