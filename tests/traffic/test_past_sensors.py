"""Motor traffic past the sensors: by level, from the finished motion, against a closed form."""

from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pytest

from urbantwin.ground import Elevation
from urbantwin.roads import Lane
from urbantwin.traffic.demand.demand import Demand, Population
from urbantwin.traffic.flow.past_sensors import traffic_past_sensors
from urbantwin.traffic.motion_rows import ACTOR_SCHEMA, as_rows

STEP_S, STEPS = 0.1, 1200


def lane(road: str, z: float, level: int, y: float, allowed: str = "car") -> Lane:
    """A lane along x, from 200 m west to 200 m east of the sensor."""
    x = np.linspace(-200.0, 200.0, 81)
    centre = np.column_stack([x, np.full(81, y), np.full(81, z)])
    return Lane(f"{road}_0", road, "driving", 3.0, 13.9, centre, np.zeros((0, 2)), level,
                (allowed,), (), "")  # fmt: skip


def twin(*lanes: Lane, **sensor: float):
    """What of a twin the measure reads: lanes, flat ground, a rig of one sensor."""
    one = SimpleNamespace(**{"east_m": 0.0, "north_m": 0.0, "up_m": None, **sensor})
    rig = SimpleNamespace(sensors=[one], label_range_m=None)
    roads = SimpleNamespace(lanes=lanes)
    return SimpleNamespace(
        rig_spec=lambda: rig, roads=roads, elevation=Elevation.flat(),
        manifest={"files": {"rig.yaml": ""}},
    )  # fmt: skip


def driving(road: str, speed: float, every_s: float, y: float, kind: str = "car") -> list[dict]:
    """Rows of vehicles that follow each other at a constant speed, through all the motion."""
    rows = []
    first = int(-400.0 / speed / every_s) - 1
    for number in range(first, int(STEPS * STEP_S / every_s) + 1):
        for step in range(STEPS):
            x = -200.0 + speed * (step * STEP_S - number * every_s)
            if -200.0 <= x <= 200.0:
                rows.append({"time_s": step * STEP_S, "track": number - first + 1, "class": kind,
                             "x": x, "y": y, "speed": speed, "lane": f"{road}_0"})  # fmt: skip
    return rows


def table(rows: list[dict]):
    """Rows with every other column of the table at 0."""
    rows = sorted(rows, key=lambda row: (row["time_s"], row["track"]))
    columns = {}
    for field in ACTOR_SCHEMA:
        empty = "" if pa.types.is_string(field.type) else 0
        columns[field.name] = pa.array([row.get(field.name, empty) for row in rows], field.type)
    return as_rows(pa.table(columns, schema=ACTOR_SCHEMA))


def demand(**per_hour: float) -> Demand:
    """Motor vehicles an hour that come from beyond the region onto roads."""
    planned = {("beyond", road): rate for road, rate in per_hour.items()}
    group = (Population("car", sum(per_hour.values()), 1, 1.0, 1.0),)
    return Demand((), (), group, frozenset({"beyond"}), planned=planned)


def measured(twin, demand: Demand, rows: list[dict]):
    return traffic_past_sensors(twin, demand, table(rows), planned_s=1.0, steps=STEPS)


def test_a_steady_stream_is_its_own_flow() -> None:
    """A vehicle every 6 s is 600 an hour, at any speed; of 800 planned."""
    place = twin(lane("street", 0.0, 0, 3.0))
    for speed in (5.3, 12.1):
        told = measured(place, demand(street=800.0), driving("street", speed, 6.0, 3.0))
        assert told["asked_per_hour"] == 800.0
        assert told["driven_per_hour"] == pytest.approx(600.0, rel=0.03)
        assert told["lanes_m"] == pytest.approx(2 * np.sqrt(50.0**2 - 3.0**2), abs=4.0)
        assert told["lanes_without_demand_m"] == 0.0
    assert told["vehicles"] == pytest.approx(STEPS * STEP_S / 6.0 + 100.0 / 12.1 / 6.0, abs=1.1)


def test_traffic_on_the_bridge_above_does_not_count_for_a_sensor_below() -> None:
    street, deck = lane("street", 0.0, 0, 3.0), lane("deck", 5.5, 1, -6.0)
    ramp = lane("ramp", 4.0, 0, 9.0)
    above = driving("deck", 19.3, 3.0, -6.0)
    told = measured(twin(street, deck, ramp), demand(deck=1200.0, ramp=50.0), above)
    assert (told["asked_per_hour"], told["driven_per_hour"], told["vehicles"]) == (0.0, 0.0, 0)
    assert told["lanes_without_demand_m"] == told["lanes_m"] == pytest.approx(100.0, abs=4.0)
    # A sensor on the bridge sees the other way round.
    on_top = twin(street, deck, north_m=-6.0)
    told = measured(on_top, demand(deck=1200.0, street=90.0), above)
    assert told["asked_per_hour"] == 1200.0
    assert told["driven_per_hour"] == pytest.approx(1200.0, rel=0.05)
    # One under it, whose height is given, does not.
    told = measured(twin(street, deck, north_m=-6.0, up_m=4.0), demand(deck=1200.0), above)
    assert told["asked_per_hour"] == 0.0


def test_who_stands_or_is_no_motor_vehicle_has_not_driven() -> None:
    place = twin(lane("street", 0.0, 0, 3.0))
    still = [{"time_s": k * STEP_S, "track": 1, "class": "car", "x": 0.0, "y": 3.0, "speed": 0.0,
              "lane": "street_0"} for k in range(STEPS)]  # fmt: skip
    told = measured(place, demand(street=500.0), still)
    assert (told["driven_per_hour"], told["vehicles"]) == (0.0, 1)
    cycling = driving("street", 5.0, 6.0, 3.0, kind="bicycle")
    assert measured(place, demand(street=500.0), cycling)["vehicles"] == 0
