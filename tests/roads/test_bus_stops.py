"""Stops are on the lane beside which people wait, lines on the roads that they are mapped on."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapely

from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.roads import RoadNetwork, build_roads
from urbantwin.site import read_extract

FRAME = SiteFrame(48.7, 9.18)
STREET = {"highway": "secondary", "lanes": "2", "name": "Long Street"}
SIDE = {"highway": "residential", "name": "Side Street"}
#: Poles beside the street that runs east, on its south side and on its north side.
SOUTH, NORTH = (-60.0, -7.0), (60.0, 7.0)


def town(write_osm: Callable[..., Path], tmp_path: Path, driving_side: str) -> RoadNetwork:
    pole = {"highway": "bus_stop", "name": "Corner"}
    nodes = {
        1: (-200, 0, {}), 2: (0, 0, {}), 3: (200, 0, {}), 4: (0, 200, {}),
        5: (*SOUTH, {**pole, "name": "South"}), 6: (*NORTH, {**pole, "name": "North"}),
        7: (NORTH[0] + 3, 8.0, {"public_transport": "platform", "bus": "yes"}),
        8: (100.0, 90.0, pole),
    }  # fmt: skip
    osm = write_osm(nodes, {10: ((1, 2, 3), STREET), 11: ((2, 4), SIDE)})
    return built(with_a_line(osm), tmp_path, driving_side)


def with_a_line(osm: Path) -> Path:
    """Map a bus line on way 10."""
    line = (
        '<relation id="1" version="1"><member type="way" ref="10" role=""/>'
        '<tag k="type" v="route"/><tag k="route" v="bus"/></relation></osm>'
    )
    osm.write_text(osm.read_text(encoding="utf-8").replace("</osm>", line), encoding="utf-8")
    return osm


def built(osm: Path, tmp_path: Path, side: str = "right", west: float = -150) -> RoadNetwork:
    return build_roads(
        read_extract(osm),
        FRAME,
        shapely.box(west, -150, 150, 150),
        Elevation.flat(),
        driving_side=side,
        out=tmp_path / "town.net.xml",
    ).network


@pytest.mark.parametrize("driving_side", ["right", "left"])
def test_a_stop_is_where_people_get_on(
    write_osm: Callable[..., Path], tmp_path: Path, driving_side: str
) -> None:
    network = town(write_osm, tmp_path, driving_side)
    # One for each side; the platform is the northern pole's, and none is beside the far one.
    assert sorted(stop.name for stop in network.stops) == ["North", "South"]
    for stop in network.stops:
        lane = network.lane_by_id[stop.lane]
        assert lane.kind in ("driving", "bus")
        line = shapely.LineString(lane.centre[:, :2])
        pole = np.array(SOUTH if stop.name == "South" else NORTH)
        front = shapely.get_coordinates(line.interpolate(stop.end_m))[0]
        ahead = front - shapely.get_coordinates(line.interpolate(stop.start_m))[0]
        to_pole = pole - front
        # The door is beside the pole, on the right of who drives on the right.
        assert np.linalg.norm(to_pole) < 9.0
        on_left = float(ahead[0] * to_pole[1] - ahead[1] * to_pole[0]) > 0
        assert on_left == (driving_side == "left")
        assert stop.end_m - stop.start_m > 12.0


def test_lines_run_where_they_are_mapped(write_osm: Callable[..., Path], tmp_path: Path) -> None:
    network = town(write_osm, tmp_path, "right")
    names = {road.id: road.name for road in network.roads}
    assert {names[road] for road in network.bus_roads} == {"Long Street"}
    assert set(names.values()) >= {"Long Street", "Side Street"}


def test_stops_are_kept_in_the_file(write_osm: Callable[..., Path], tmp_path: Path) -> None:
    network = town(write_osm, tmp_path, "right")
    network.save(tmp_path / "roads.json")
    again = RoadNetwork.load(tmp_path / "roads.json")
    assert (again.stops, again.bus_roads) == (network.stops, network.bus_roads)


def test_a_stop_has_a_footway_where_the_map_gives_its_street_none(
    write_osm: Callable[..., Path], tmp_path: Path
) -> None:
    """On its own side, as far as the next junctions, and nowhere else."""
    nodes = {1: (-200, 0, {}), 2: (0, 0, {}), 3: (200, 0, {}), 4: (0, 200, {})}
    nodes |= {5: (*SOUTH, {"highway": "bus_stop"})}
    bare = {**STREET, "sidewalk": "no"}
    network = built(write_osm(nodes, {10: ((1, 2, 3), bare), 11: ((2, 4), bare)}), tmp_path)
    walks = [lane for lane in network.lanes if lane.kind == "sidewalk"]
    (walk,) = [lane for lane in walks if not lane.road.startswith("stand")]
    place = shapely.Point(SOUTH)
    assert walk.polygon.distance(place) < 1.5
    assert walk.centre[:, 1].max() < -3.0
    assert walk.centre[:, 0].max() < 1.0, "the junction ends it"


def test_a_stop_is_not_beyond_another_carriageway(
    write_osm: Callable[..., Path], tmp_path: Path
) -> None:
    """A slip lane runs between the street of the line and the pole, which is mapped on its edge."""
    nodes = {1: (-200, 0, {}), 2: (0, 0, {}), 3: (200, 0, {}), 4: (200, 60, {})}
    nodes |= {6: (-120, -12, {}), 7: (-30, -12, {}), 8: (-170, 0, {})}
    nodes |= {5: (-70, -13, {"highway": "bus_stop"})}
    one_way = {"highway": "primary", "lanes": "2", "oneway": "yes"}
    slip = {"highway": "primary_link", "oneway": "yes"}
    ways = {10: ((1, 8, 2, 3), one_way), 12: ((8, 6, 7, 2), slip), 13: ((4, 2), one_way)}
    network = built(with_a_line(write_osm(nodes, ways)), tmp_path, west=-190)
    (stop,) = network.stops
    (road,) = [road for road in network.roads if stop.lane in road.lanes]
    assert road.ways == (12,)
