"""People on foot are on footways: moved off the lanes that vehicles cut corners on, not far."""

import numpy as np
import pytest
import shapely

from urbantwin.roads.network import Lane, Road, RoadNetwork
from urbantwin.traffic.demand.demand import Demand, Trip
from urbantwin.traffic.paths.footing import BODY_M, on_footways
from urbantwin.traffic.sumo.observed import Observed
from urbantwin.traffic.sumo.simulation import Simulated

NONE = np.zeros((0, 0))


def lane(name: str, kind: str, y: float, width: float) -> Lane:
    centre = np.array([[0.0, y, 0.0], [50.0, y, 0.0]])
    return Lane(name, "r", kind, width, 14.0, centre, np.zeros((0, 2)), 0, (), (), "")


#: A carriageway of y = -2 to 2; a sidewalk of y = 1.5 to 4.5, its first half metre driven on.
NETWORK = RoadNetwork(
    "right",
    (Road("r", "", (), "", ("r_0", "r_1"), "", ""),),
    (lane("r_0", "sidewalk", 3.0, 3.0), lane("r_1", "driving", 0.0, 4.0)),
    (),
    (),
    (),
)


def seen(kind: str, lane_number: int, places: list[tuple[float, float]]) -> np.ndarray:
    count = len(places)
    observed = Observed(NONE, NONE, NONE, NONE, NONE, 0.0, ())
    whole = np.zeros(count, np.int32)
    simulated = Simulated(
        np.arange(count, dtype=np.int32), whole, np.array(places), np.zeros(count),
        np.ones(count), whole + lane_number, ("r_0", "r_1"), (), 0, 0, frozenset({0}), "", observed,
    )  # fmt: skip
    demand = Demand((Trip(kind, "x", 0.0, ("r",)),), ())
    return on_footways(simulated, demand, NETWORK).front


@pytest.mark.parametrize("y", [1.5, 2.0, 4.6])
def test_who_walks_on_the_carriageway_or_in_a_wall_is_moved_beside(y: float) -> None:
    (place,) = seen("pedestrian", 0, [(20.0, y)])
    assert NETWORK.footway(0).contains(shapely.Point(place).buffer(BODY_M * 0.99))
    assert place[0] == pytest.approx(20.0)
    assert abs(place[1] - y) <= 1.2


def test_who_is_on_the_footway_or_far_away_or_drives_stays() -> None:
    places = [(10.0, 3.0), (10.0, 2.4), (10.0, -1.0)]
    np.testing.assert_array_equal(seen("pedestrian", 0, places), places)
    np.testing.assert_array_equal(seen("car", 1, [(10.0, 1.9)]), [(10.0, 1.9)])
    np.testing.assert_array_equal(seen("pedestrian", 1, [(10.0, 1.9)]), [(10.0, 1.9)])
