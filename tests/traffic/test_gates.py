"""Gates: as many come in as requested, and no more than the streets carry."""

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from tests.traffic.test_circulation import PER_HOUR, REGION, town  # noqa: F401 - a fixture

from urbantwin.roads.assignment.street_network import StreetNetwork
from urbantwin.taxonomy import ACTOR_CLASSES
from urbantwin.traffic.assets import Fleet, asset
from urbantwin.traffic.demand.circulation import Circulation
from urbantwin.traffic.sumo.simulation import Simulated, observe

WARMUP, SECONDS = 120, 480
MOTOR = [ACTOR_CLASSES.index(name) for name in ("car", "truck", "bus", "motorcycle")]


def driven(
    town,  # noqa: F811
    tmp_path: Path,
    times: float,
    seconds: int = SECONDS,
) -> tuple[Simulated, list[dict[str, float]], dict]:
    """A multiple of the traffic: what was observed, SUMO's own summary and its edges' queues."""
    network = StreetNetwork(town[0], REGION)
    per_hour = {name: times * rate for name, rate in PER_HOUR.items()}
    circulation = Circulation(network, town[1], per_hour, 3)
    inside = [x for x in network.streets if x.getID() not in town[1]]
    room = {edge.getID(): edge.getLength() * edge.getLaneNumber() / 7.0 for edge in inside}
    demand = circulation.demand(
        circulation.populations(),
        warmup_s=WARMUP,
        duration_s=seconds - WARMUP,
        body=Fleet().body,
        room=room,
    )
    summary, loops = tmp_path / f"{times}.xml", tmp_path / f"{times}-stops.xml"
    seen = observe(
        town[0],
        demand,
        asset,
        seconds=seconds,
        step_ms=500,
        seed=3,
        warmup_s=WARMUP,
        outputs={"summary-output": summary, "stop-output": loops},
    )
    rows = [
        {key: float(row.get(key)) for key in ("time", "inserted", "running", "teleports")}
        for row in ElementTree.parse(summary).iter("step")
    ]
    waits = [stop.attrib for stop in ElementTree.parse(loops).iter("stopinfo")]
    return seen, rows, waits


def test_the_requested_rate_comes_in(town, tmp_path: Path) -> None:  # noqa: F811
    """Entries counted at the border, within 10 % and three deviations of a Poisson count."""
    seen, _, waits = driven(town, tmp_path, 1.0)
    after = slice(WARMUP // 60, SECONDS // 60)
    entries = seen.observed.entries[after, MOTOR].sum()
    asked = sum(PER_HOUR[ACTOR_CLASSES[k]] for k in MOTOR) * (SECONDS - WARMUP) / 3600
    assert abs(entries - asked) < 0.1 * asked + 3 * np.sqrt(asked)
    # Who comes too early waits at a gate, on an outer road, and nowhere else.
    assert waits
    assert {stop["lane"].rpartition("_")[0] for stop in waits} <= town[1]


@pytest.mark.thorough
def test_streets_that_carry_less_than_requested_do_not_lock_up(town, tmp_path: Path) -> None:  # noqa: F811
    """Eight times the traffic: SUMO's own summary shows nobody added late and nobody lifted."""
    seen, rows, waits = driven(town, tmp_path, 8.0)
    late = [row for row in rows if row["time"] > WARMUP + 60]
    assert {row["inserted"] for row in late} == {late[0]["inserted"]}
    assert {row["running"] for row in late} == {late[0]["inserted"]}
    assert late[-1]["teleports"] == 0
    assert seen.observed.vehicle_halt_s < 300
    assert {stop["lane"].rpartition("_")[0] for stop in waits} <= town[1]
    # The flow holds to the end: no less in the second half than in the first.
    metres = seen.observed.metres[WARMUP // 60 : SECONDS // 60, MOTOR].sum(axis=1)
    first, second = np.array_split(metres, 2)
    assert second.mean() > 0.85 * first.mean()


def test_the_same_seed_gives_the_same_traffic(town, tmp_path: Path) -> None:  # noqa: F811
    one, two = (driven(town, tmp_path, 2.0, 240)[0] for _ in range(2))
    assert one.departed == two.departed
    assert np.array_equal(one.observed.metres, two.observed.metres)
