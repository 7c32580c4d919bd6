"""A street under a bridge: each part of the network has its own traffic, metered by itself."""

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely

from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.roads import build_roads
from urbantwin.roads.assignment.street_network import StreetNetwork
from urbantwin.traffic.assets import Fleet, asset
from urbantwin.traffic.demand.circulation import Circulation
from urbantwin.traffic.sumo.simulation import observe

REGION = shapely.box(-120, -120, 120, 120)
WARMUP, SECONDS = 120, 1320
CARS = 1200.0


@pytest.fixture(scope="module")
def crossing(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, frozenset[str], dict]:
    """A fast trunk road on a bridge over a slow secondary street, which nothing joins."""
    folder = tmp_path_factory.mktemp("parts")
    places = {1: (-200, 0), 2: (-40, 0), 3: (40, 0), 4: (200, 0), 5: (0, -200), 6: (0, 200)}
    nodes = "".join(
        f'<node id="{k}" version="1" lat="{48.7 + y / 111_194.9:.9f}" '
        f'lon="{9.18 + x / 73_391.0:.9f}"/>'
        for k, (x, y) in places.items()
    )
    above = {"highway": "trunk", "lanes": "4", "maxspeed": "80"}
    ways = ""
    for way, (refs, tags) in {
        10: ((1, 2), above),
        11: ((2, 3), {**above, "bridge": "yes", "layer": "1"}),
        12: ((3, 4), above),
        20: ((5, 6), {"highway": "secondary", "lanes": "2", "maxspeed": "30"}),
    }.items():
        inner = "".join(f'<nd ref="{n}"/>' for n in refs)
        inner += "".join(f'<tag k="{k}" v="{v}"/>' for k, v in tags.items())
        ways += f'<way id="{way}" version="1">{inner}</way>'
    osm = folder / "map.osm"
    osm.write_text(f'<osm version="0.6">{nodes}{ways}</osm>')
    net = folder / "map.net.xml"
    built = build_roads(
        read_osm(osm), SiteFrame(48.7, 9.18), REGION, Elevation.flat(), driving_side="right",
        out=net, closed_loop=True,
    )  # fmt: skip
    ways_of = {road.id: set(road.ways) for road in built.network.roads}
    return net, frozenset(road for road, ways in ways_of.items() if not ways), ways_of


def read_osm(path: Path):
    from urbantwin.site import read_extract

    return read_extract(path)


def test_each_level_has_its_share_by_class_and_lanes(crossing) -> None:
    """Trunk 300, secondary 175 an hour and lane that lead in: 4 and 2 of them."""
    net, outer, ways_of = crossing
    circulation = Circulation(StreetNetwork(net, REGION), outer, {"car": CARS}, 3)
    demand = circulation.demand(
        circulation.populations(), warmup_s=WARMUP, duration_s=60.0, body=Fleet().body,
        room=dict.fromkeys(ways_of, 20.0),
    )  # fmt: skip
    share = 4 * 300 / (4 * 300 + 2 * 175)
    for way, wanted in ((11, share), (20, 1.0 - share)):
        into = sum(
            rate for (a, b), rate in demand.planned.items()
            if way in ways_of[b] and way not in ways_of[a]
        )  # fmt: skip
        assert into == pytest.approx(CARS * wanted, rel=1e-3)
    assert len(demand.gates.parts) == 2
    by_part = [
        sum(gate.per_hour for gate in demand.gates.gates if gate.part == k) for k in range(2)
    ]
    assert sorted(by_part) == pytest.approx([CARS * (1 - share), CARS * share], rel=1e-3)
    # Little's law: where the way round takes longer, as many more vehicles are on their way.
    upper = {edge for edge, ways in ways_of.items() if ways & {10, 11, 12}}
    first = [trip for trip in demand.trips if not trip.in_reserve]
    on_top = sum(bool(upper & set(trip.edges)) for trip in first)
    assert 0 < on_top < share * len(first)


@pytest.mark.thorough
def test_sumo_counts_what_is_planned_on_both_levels(crossing, tmp_path: Path) -> None:
    net, outer, ways_of = crossing
    circulation = Circulation(StreetNetwork(net, REGION), outer, {"car": CARS}, 3)
    demand = circulation.demand(
        circulation.populations(), warmup_s=WARMUP, duration_s=SECONDS - WARMUP,
        body=Fleet().body, room=dict.fromkeys(ways_of, 20.0),
    )  # fmt: skip
    counted = tmp_path / "edges.xml"
    observe(
        net, demand, asset, seconds=SECONDS, step_ms=500, seed=3, warmup_s=WARMUP,
        outputs={"edgedata-output": counted},
    )  # fmt: skip
    entered = {
        row.get("id"): float(row.get("entered", 0))
        for row in ElementTree.parse(counted).iter("edge")
    }
    for way in (11, 20):
        edges = [edge for edge, ways in ways_of.items() if way in ways]
        wanted = sum(rate for (_, edge), rate in demand.planned.items() if edge in edges)
        seen = sum(entered.get(edge, 0.0) for edge in edges)
        expected = wanted * SECONDS / 3600.0
        assert abs(seen - expected) < 0.15 * expected + 3 * np.sqrt(expected)
