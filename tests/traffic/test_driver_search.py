"""The search for drivers, in worlds whose figures are closed forms of them."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from urbantwin.traffic.calibration.drivers import ROUNDS, fitted_drivers
from urbantwin.traffic.calibration.measured import Measured

#: Who drives, and how figures answer: more and less than is expected of them, and to each other.
TRUE = {"speed_factor": 0.8, "standing_gap_m": 2.9, "headway_s": 1.6, "queue_headway_s": 1.1}
NOTHING = Measured(600.0, {}, {}, {})


def world(drivers: Mapping[str, float], noise: np.random.Generator, count: int) -> Measured:
    speed, gap = drivers["speed_factor"], drivers["standing_gap_m"]
    headway, queue = drivers["headway_s"], drivers["queue_headway_s"]

    def values(mean: float, spread: float) -> list[float]:
        return (mean + spread * noise.standard_normal(count)).tolist()

    return replace(
        NOTHING,
        free={"b": values(0.9 * speed**0.7, 0.08), "c": values(0.4, 0.01)},  # c: held up
        gaps=values(gap + 0.1, 0.3),
        driving=values(0.2 + 0.6 * headway + 0.1 * gap, 0.2),
        discharge={"a": values(1.4 + 0.3 * queue + 0.4 * headway, 0.3)},
    )


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_drivers_of_a_world_in_closed_form_are_found(seed: int) -> None:
    noise = np.random.default_rng(seed)
    rounds = []

    def simulated(drivers: Mapping[str, float], turn: int) -> Measured:
        rounds.append(turn)
        return world(drivers, noise, 150)

    found, _, _ = fitted_drivers(world(TRUE, noise, 2000), simulated)
    assert len(rounds) <= ROUNDS
    assert found["speed_factor"] == pytest.approx(TRUE["speed_factor"], rel=0.05)
    assert found["standing_gap_m"] == pytest.approx(TRUE["standing_gap_m"], abs=0.15)
    assert found["headway_s"] == pytest.approx(TRUE["headway_s"], abs=0.15)
    # A third of what is simulated of it is noise: 0.3 s to 150 values, and 0.3 of an answer.
    assert found["queue_headway_s"] == pytest.approx(TRUE["queue_headway_s"], abs=0.35)


def test_bends_are_taken_as_on_the_way_that_tells_them() -> None:
    """Who gives way in one turn takes the other as it likes: the other is fitted."""

    def turns(sideways: float) -> Measured:
        """v2/r on a curve of 12 m, of the map, which is driven as one of 15 m."""
        ways = {("a", "b"): [sideways] * 12, ("c", "d"): [1.0] * 40, ("e", "f"): [9.0]}
        speeds = {("a", "b"): [(15.0 * sideways) ** 0.5] * 12, ("c", "d"): [5.0] * 40}
        return replace(NOTHING, bends=ways, turning=speeds)

    found, told, _ = fitted_drivers(
        turns(3.4), lambda drivers, _: turns(0.8 * drivers["sideways_acceleration"])
    )
    assert found["sideways_acceleration"] == pytest.approx(3.4 / 0.8, rel=0.05)
    (row,) = told
    assert (row["recorded"], row["count"]) == (pytest.approx((15 * 3.4) ** 0.5, abs=1e-3), 12)


def test_queues_that_are_told_one_by_one_do_not_tell_the_others_again() -> None:
    """Each approach has its own headway; what few left elsewhere is their mean, or told by many."""
    own = {"n": 1.2, "s": 2.0}

    def queues(drivers: Mapping[str, float], others: int) -> Measured:
        headways = {
            name: [1.4 + drivers.get(f"queue_headway_s on {name}", 1.35) / 2 + 0.01 * k / 40
                   for k in range(40)]
            for name in own
        }  # fmt: skip
        elsewhere = [1.0 + drivers["queue_headway_s"] / 2] * others
        return replace(NOTHING, discharge={**headways, "w": elsewhere})

    true = {f"queue_headway_s on {name}": value for name, value in own.items()}
    for others, usual in ((6, None), (12, 0.9)):
        recorded = queues({**true, "queue_headway_s": 0.9}, others)
        found, told, _ = fitted_drivers(recorded, lambda x, _, n=others: queues(x, n))  # type: ignore[misc]
        # Drawn towards the median of all: 40 / 60 of the way is theirs.
        assert 1.2 < found["queue_headway_s on n"] < found["queue_headway_s on s"] < 2.0
        mean = (found["queue_headway_s on n"] + found["queue_headway_s on s"]) / 2
        wanted = pytest.approx(mean, abs=0.01) if usual is None else pytest.approx(usual, abs=0.15)
        assert found["queue_headway_s"] == wanted
        assert len(told) == 2 + (usual is not None)
