"""Places that are found for events which cannot be staged where they were asked for."""

import numpy as np
import pytest

from urbantwin.errors import StageError
from urbantwin.traffic.events.elsewhere import places_that_serve, staged_near
from urbantwin.traffic.events.places import find_spot
from urbantwin.traffic.events.scenario import HardBrake, WorkZone, WrongWay
from urbantwin.traffic.motion import ACTOR_SCHEMA
from urbantwin.twin import Twin

EAST = {"x": -40.0, "y": -2.0}  # on the way to the junction from the west


def table(*cars: tuple[int, str, float, float, float, float]):
    """Cars for ten seconds: track, lane, x, y, and their speeds along x and y."""
    rows = []
    for step in range(101):
        for track, lane, x, y, vx, vy in cars:
            row = dict.fromkeys(ACTOR_SCHEMA.names, 0.0)
            row |= {"time_s": step / 10, "track": track, "lane": lane, "phase": 0}
            row |= {"class": "car", "asset": "car-sedan", "speed": float(np.hypot(vx, vy))}
            rows.append(row | {"x": x + vx * step / 10, "y": y + vy * step / 10})
    return ACTOR_SCHEMA.empty_table().from_pylist(rows, ACTOR_SCHEMA)


def test_who_is_to_brake_has_to_drive_there(crossing_twin: Twin) -> None:
    event = HardBrake(event="hard_brake", at_s=1.0, place=EAST, within_s=8.0)
    asked = find_spot(event.place, crossing_twin, "car")
    south = find_spot(event.place.model_copy(update={"x": 2.0, "y": -40.0}), crossing_twin, "car")
    queue = (1, asked.lane.id, -40.0, -2.0, 0.0, 0.0)
    coming = (2, south.lane.id, 2.0, -80.0, 0.0, 8.0)
    (spot, told), *_ = places_that_serve(event, crossing_twin, table(queue, coming))
    assert spot.lane == south.lane
    assert told["moved_m"] == pytest.approx(float(np.hypot(*(spot.xy - asked.xy))), abs=0.06)
    assert told["moved_m"] <= event.within_m
    driving = (1, asked.lane.id, -90.0, -2.0, 8.0, 0.0)
    (spot, told), *_ = places_that_serve(event, crossing_twin, table(driving, coming))
    assert (spot.lane, told) == (asked.lane, {})
    # With nobody to brake anywhere, and with no other place allowed, it stays where it is.
    near = event.model_copy(update={"within_m": 0.0})
    for one, cars in ((event, [queue]), (near, [queue, coming])):
        assert [told for _, told in places_that_serve(one, crossing_twin, table(*cars))] == [{}]


def test_a_work_zone_goes_where_the_lane_is_free(crossing_twin: Twin) -> None:
    event = WorkZone(event="work_zone", at_s=1.0, place=EAST, within_s=8.0, length_m=8.0)
    asked = find_spot(event.place, crossing_twin, "car")
    waits = (1, asked.lane.id, -36.0, -2.0, 0.0, 0.0)
    (spot, told), *_ = places_that_serve(event, crossing_twin, table(waits))
    assert told["moved_m"] > 1.0
    assert spot.lane.id != asked.lane.id or abs(spot.along_m - asked.along_m) > 5.0


def test_the_nearest_place_where_nobody_stands_is_tried_first(crossing_twin: Twin) -> None:
    event = WrongWay(event="wrong_way", at_s=5.0, place=EAST, within_m=60.0)
    asked = find_spot(event.place, crossing_twin, "car")
    queue = [(k, asked.lane.id, -6.0 * k, -2.0, 0.0, 0.0) for k in range(2, 20)]
    tried: list[np.ndarray] = []

    def stage(one: WrongWay) -> str:
        tried.append(find_spot(one.place, crossing_twin, "car").xy)
        if len(tried) < 3:
            raise StageError("in the way")
        return "staged"

    refused = StageError("a queue")
    made, told = staged_near(event, crossing_twin, table(*queue), stage, refused)
    assert (made, told["moved_because"]) == ("staged", "a queue")
    away = [float(np.hypot(*(one - asked.xy))) for one in tried]
    assert away == sorted(away)
    assert max(away) <= 60.0
    assert min(float(np.abs(one[1] + 2.0)) for one in tried) > 2.5  # not in the queue's lane
    tried.clear()
    with pytest.raises(StageError, match=r"a queue; nor at \d+ other places within 60 m"):
        staged_near(event, crossing_twin, table(*queue), lambda _: stage_never(), refused)


def stage_never() -> str:
    raise StageError("never")
