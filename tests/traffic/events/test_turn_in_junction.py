"""A street whose directions an island parts is turned round on in the junction at its end."""

from types import SimpleNamespace

import numpy as np
import shapely

from urbantwin.roads import Lane
from urbantwin.traffic.events.places import spot_on
from urbantwin.traffic.events.u_turn import _in_junction, _omega

EVENT = SimpleNamespace(actor="car", at_s=0.0)


def lane(name: str, start: tuple[float, float], end: tuple[float, float]) -> Lane:
    centre = np.array([[*start, 0.0], [*end, 0.0]])
    nothing = np.zeros((0, 2))
    return Lane(name, "r", "driving", 3.5, 13.9, centre, nothing, 0, ("car",), (), "")


def test_the_turn_leads_round_the_island_onto_the_nearest_lane_back() -> None:
    there = lane("there_0", (-80.0, -6.0), (0.0, -6.0))
    near, far = (lane(f"back_{k}", (0.0, y), (-80.0, y)) for k, y in enumerate((6.0, 9.5)))
    along = lane("along_0", (20.0, -6.0), (80.0, -6.0))
    across = lane("across_0", (10.0, 20.0), (10.0, 80.0))
    twin = SimpleNamespace(roads=SimpleNamespace(lanes=(there, far, near, along, across)))
    found = list(_in_junction(EVENT, spot_on(there, 55.0), twin))  # type: ignore[arg-type]
    assert [back.lane.id for _, back in found[:4]] == ["back_0"] * 4
    assert {back.lane.id for _, back in found} == {"back_0", "back_1"}
    road = shapely.box(-80, -7.75, 0, -4.25).union(shapely.box(-80, 4.25, 0, 11.25))
    road = road.union(shapely.box(0, -12, 20, 12))
    for spot, back in found:
        turn = _omega(spot, back, 5.0)
        assert turn[0] @ [0, 1] == -6.0
        np.testing.assert_allclose(turn[-1], [spot.xy[0], back.xy[1]], atol=0.05)
        assert road.buffer(0.01).contains(shapely.LineString(turn))
    # From far away one does not go to the junction for it.
    assert not list(_in_junction(EVENT, spot_on(there, 5.0), twin))  # type: ignore[arg-type]
