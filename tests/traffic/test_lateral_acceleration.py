"""Nobody takes a curve faster than wheels hold: the motion's own headings, differentiated."""

from collections.abc import Callable

import numpy as np
import pytest

from urbantwin.traffic import Motion
from urbantwin.twin import Twin

from ..thorough import further

pytestmark = pytest.mark.thorough

#: Over which time a turn is measured, seconds, and what is never exceeded, m/s^2.
OVER_S, MOST_MS2 = 0.5, 4.0
ON_FOOT = ("pedestrian", "animal")


def sideways(motion: Motion) -> dict[str, list[float]]:
    """The greatest speed times rate of turn of each who drives, by class."""
    names = ("track", "time_s", "yaw", "speed", "class")
    table = {name: motion.actors[name].to_numpy(zero_copy_only=False) for name in names}
    step_s = motion.manifest["step_s"]
    apart = round(OVER_S / step_s)
    order = np.lexsort([table["time_s"], table["track"]])
    found: dict[str, list[float]] = {}
    for rows in np.split(order, np.flatnonzero(np.diff(table["track"][order])) + 1):
        name = table["class"][rows[0]]
        if name in ON_FOOT or len(rows) <= apart:
            continue
        yaw, speed = np.unwrap(table["yaw"][rows]), table["speed"][rows]
        seconds = table["time_s"][rows][apart:] - table["time_s"][rows][:-apart]
        whole = seconds < OVER_S + 1.5 * step_s
        turn = (yaw[apart:] - yaw[:-apart]) / seconds
        taken = np.abs(turn * (speed[apart:] + speed[:-apart]) / 2)[whole]
        found.setdefault(name, []).append(float(taken.max(initial=0.0)))
    return found


@pytest.mark.parametrize("place", ["two-avenues", *further("manchester-kingsway")])
def test_on_real_streets_everybody_turns_gently(
    real_drive: Callable[[str], tuple[Twin, Motion]], place: str
) -> None:
    found = sideways(real_drive(place)[1])
    values = [x for rows in found.values() for x in rows]
    assert len(values) > 20
    # Of many who drive at the limit one may change lanes in a bend.
    assert np.mean(np.array(values) < MOST_MS2) > 0.97
    assert max(values) < 1.25 * MOST_MS2
    assert max(found["car"]) > 1.0  # somebody turned
