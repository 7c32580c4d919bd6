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
        return replace(
            NOTHING, bends={("a", "b"): [sideways] * 12, ("c", "d"): [1.0] * 40, ("e", "f"): [9.0]}
        )

    found, told, _ = fitted_drivers(
        turns(3.4), lambda drivers, _: turns(0.8 * drivers["sideways_acceleration"])
    )
    assert found["sideways_acceleration"] == pytest.approx(3.4 / 0.8, rel=0.03)
    (row,) = told
    assert (row["recorded"], row["count"]) == (3.4, 12)
