"""A cropped network that falls apart: the main part stays, the rest is named; bridges stay."""

import pytest
import shapely

from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.roads import build_roads
from urbantwin.site import read_extract

FRAME = SiteFrame(48.7, 9.18)
STREET = {"highway": "residential"}


@pytest.mark.parametrize("closed_loop", [False, True])
def test_what_the_border_cuts_off_is_left_out_and_named(write_osm, tmp_path, closed_loop):
    """A bow of Ring Road leaves the region; its far piece comes back in, joined to nothing."""
    nodes = {1: (-120, 0, {}), 2: (0, 0, {}), 3: (120, 0, {}), 4: (0, 90, {}), 5: (0, -60, {})}
    nodes |= {6: (0, 160, {}), 7: (200, 160, {}), 8: (200, -85, {}), 9: (60, -85, {})}
    ways = {
        1: ([1, 2, 3], {**STREET, "name": "Main Street", "lanes": "2"}),
        2: ([4, 2, 5], {**STREET, "name": "Side Street"}),
        3: ([4, 6, 7, 8, 9], {**STREET, "name": "Ring Road"}),
    }
    extract = read_extract(write_osm(nodes, ways))
    region = shapely.box(-100.0, -100.0, 100.0, 100.0)
    roads = build_roads(
        extract, FRAME, region, Elevation.flat(), driving_side="right",
        out=tmp_path / "n.net.xml", closed_loop=closed_loop,
    )  # fmt: skip
    (left,) = roads.notes["left_out"]
    assert left["names"] == "Ring Road"
    assert left["roads"] == 1
    assert left["metres"] == pytest.approx(40.0, abs=0.5)
    names = {road.name for road in roads.network.roads if road.ways}
    assert names == {"Main Street", "Side Street", "Ring Road"}
    for road in roads.network.roads:
        if road.name == "Ring Road" and road.ways:
            assert roads.network.lane_by_id[road.lanes[0]].centre[:, 1].min() > 50.0


def test_a_street_that_passes_over_is_not_left_out(write_osm, tmp_path):
    nodes = {1: (-120, 0, {}), 2: (0, 0, {}), 3: (120, 0, {}), 4: (0, 90, {}),
             5: (50, -120, {}), 6: (50, 120, {})}  # fmt: skip
    over = {"highway": "primary", "name": "Viaduct", "bridge": "yes", "layer": "1"}
    ways = {
        1: ([1, 2, 3], {**STREET, "name": "Main Street"}),
        2: ([4, 2], {**STREET, "name": "Side Street"}),
        3: ([5, 6], over),
    }
    roads = build_roads(
        read_extract(write_osm(nodes, ways)), FRAME, shapely.box(-100.0, -100.0, 100.0, 100.0),
        Elevation.flat(), driving_side="right", out=tmp_path / "n.net.xml",
    )  # fmt: skip
    assert roads.notes["left_out"] == []
    assert "Viaduct" in {road.name for road in roads.network.roads}


@pytest.mark.parametrize("closed_loop", [False, True])
def test_a_road_that_leads_only_into_a_tunnel_stands_up_to_its_portal(
    write_osm, tmp_path, closed_loop
):
    """A motorway passes under the main street; a yard beside it is joined to nothing."""
    nodes = {1: (0, -120, {}), 2: (0, 0, {}), 3: (0, 120, {}), 4: (90, -30, {}),
             5: (-120, 40, {}), 6: (-30, 40, {}), 7: (30, 40, {}), 8: (120, 40, {}),
             9: (60, 60, {}), 10: (60, 80, {})}  # fmt: skip
    motorway = {"highway": "motorway", "oneway": "yes", "lanes": "2", "name": "Motorway"}
    ways = {
        1: ([1, 2, 3], {**STREET, "lanes": "2", "name": "Main Street"}),
        2: ([4, 2], {**STREET, "name": "Side Street"}),
        3: ([5, 6], motorway),
        4: ([6, 7], {**motorway, "tunnel": "yes", "layer": "-1"}),
        5: ([7, 8], motorway),
        6: ([9, 10], {**STREET, "name": "Yard"}),
    }
    roads = build_roads(
        read_extract(write_osm(nodes, ways)), FRAME, shapely.box(-100.0, -100.0, 100.0, 100.0),
        Elevation.flat(), driving_side="right", out=tmp_path / "n.net.xml", closed_loop=closed_loop,
    )  # fmt: skip
    assert [left["names"] for left in roads.notes["left_out"]] == ["Yard"]
    assert roads.notes["roads_before_portals"] == 2
    ends = {
        road.ways: [roads.network.lane_by_id[road.lanes[0]].centre[k, 0] for k in (0, -1)]
        for road in roads.network.roads
        if road.name == "Motorway" and road.ways
    }
    assert sorted(ends) == [(3,), (5,)]
    assert ends[3,] == pytest.approx([-100.0, -30.0], abs=1.0)
    assert ends[5,] == pytest.approx([30.0, 100.0], abs=1.0)
