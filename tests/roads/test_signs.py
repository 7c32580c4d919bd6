"""Signs of speed limits, stop and give way, on streets drawn by hand."""

import math

import pytest
import shapely

from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.roads import build_roads
from urbantwin.roads.signals import heads_of
from urbantwin.site import read_extract

HERE = SiteFrame(48.7, 9.18)


@pytest.fixture
def signs(write_osm, tmp_path, monkeypatch):
    """Return a function: nodes, ways, country -> the signs of the roads built from them."""

    def build(nodes, ways, country="DE", side="right"):
        monkeypatch.setattr("urbantwin.roads.build.country_of", lambda *_: country)
        built = build_roads(
            read_extract(write_osm(nodes, ways)),
            HERE,
            shapely.box(-190, -190, 190, 190),
            Elevation.flat(),
            driving_side=side,
            out=tmp_path / "n.net.xml",
        )
        carriageway = built.network.carriageway(0)
        found = [head for head in heads_of(built.model) if not head.signal.dynamic]
        for head in found:
            assert carriageway.distance(shapely.Point(head.x, head.y)) > 0.5
        assert sum(built.notes["signs"].values()) == len(found)
        return found

    return build


def street(speed, **tags):
    return {"highway": "tertiary", "maxspeed": speed, "sidewalk": "no", "lanes": "2", **tags}


def test_limits_stand_where_streets_come_in_and_where_they_change(signs):
    """Eastward 50, then 30: one sign in each direction at the border, one each at the change."""
    nodes = {1: (-250, 0, {}), 2: (0, 0, {}), 3: (250, 0, {})}
    found = signs(nodes, {1: ([1, 2], street("50")), 2: ([2, 3], street("30"))})
    told = {(round(h.signal.value), math.cos(h.heading) < 0): h for h in found}
    assert len(found) == 4
    entering, leaving = told[50, True], told[30, True]
    assert entering.x == pytest.approx(-190 + 8, abs=1.5)
    assert leaving.x == pytest.approx(8, abs=3)
    # Traffic that goes east keeps right: south of the lanes.
    assert entering.y < -3.5
    assert told[30, False].x == pytest.approx(190 - 8, abs=1.5)
    assert told[50, False].x == pytest.approx(-8, abs=3)
    assert told[50, False].y > 3.5
    assert {(h.signal.country, h.signal.type, h.signal.unit) for h in found} == {
        ("DE", "274", "km/h")
    }


@pytest.mark.parametrize(
    ("country", "type_", "unit", "value"),
    [("US", "R2-1", "mph", 25), ("GB", "670", "mph", 25), ("AU", "R4-1", "km/h", 40)],
)
def test_limits_are_told_as_the_country_tells_them(country, type_, unit, value, signs):
    nodes = {1: (-250, 0, {}), 2: (250, 0, {})}
    found = signs(nodes, {1: ([1, 2], street("25 mph"))}, country)
    assert {(h.signal.country, h.signal.type, h.signal.unit) for h in found} == {
        (country, type_, unit)
    }
    assert {h.signal.value for h in found} == {value}
    assert all(h.z - h.signal.height / 2 >= 2.1 for h in found)


def test_a_limit_is_told_beyond_a_junction_that_is_reached_at_another(signs):
    nodes = {1: (-250, 0, {}), 2: (0, 0, {}), 3: (250, 0, {}), 4: (0, 250, {})}
    ways = {1: ([1, 2, 3], street("50")), 2: ([2, 4], street("30"))}
    found = signs(nodes, ways)
    north = [h for h in found if math.sin(h.heading) < -0.9]
    assert [h.signal.value for h in north] == [30]
    assert 5 < north[0].y < 30
    # The main street's limit is told again beyond it: some come from 30.
    assert sum(h.signal.value == 50 and abs(h.x) < 40 for h in found) == 2


def test_stop_and_give_way_stand_before_the_junction(signs):
    nodes = {1: (-250, 0, {}), 2: (0, 0, {}), 3: (250, 0, {}), 4: (0, 250, {}), 5: (0, -250, {})}
    nodes |= {6: (0, 9, {"highway": "stop"}), 7: (0, -9, {"highway": "give_way"})}
    ways = {1: ([1, 2, 3], street("50")), 2: ([4, 6, 2, 7, 5], street("50"))}
    found = [h for h in signs(nodes, ways) if not h.signal.name.startswith("limit")]
    told = {h.signal.type: h for h in found}
    assert set(told) == {"206", "205"}
    stop, give_way = told["206"], told["205"]
    assert 3 < stop.y < 20
    assert -20 < give_way.y < -3
    # They face those who come: from the north and from the south, on their right.
    assert math.sin(stop.heading) > 0.9
    assert stop.x < -3
    assert math.sin(give_way.heading) < -0.9
    assert give_way.x > 3


def test_everybody_stops_where_the_map_says_so(signs):
    nodes = {1: (-250, 0, {}), 2: (0, 0, {"highway": "stop", "stop": "all"}), 3: (250, 0, {})}
    nodes |= {4: (0, 250, {}), 5: (0, -250, {})}
    ways = {1: ([1, 2, 3], street("50")), 2: ([4, 2, 5], street("50"))}
    found = [h for h in signs(nodes, ways, "US") if h.signal.name == "stop"]
    assert len(found) == 4
    assert {h.signal.type for h in found} == {"R1-1"}
