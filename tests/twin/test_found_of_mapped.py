"""What a twin's roads have of mapped crossings and signals, on streets made for it."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from urbantwin.geometry import SiteFrame
from urbantwin.roads import Lane, RoadNetwork, SignalHead
from urbantwin.site import Extract, read_extract
from urbantwin.twin.found_of_mapped import found_of_mapped, share_known

FRAME = SiteFrame(48.7, 9.18)
REGION = shapely.box(-100.0, -100.0, 100.0, 100.0)
ROAD = {"highway": "primary"}


def lane(name: str, kind: str, points: list[tuple[float, float]], width: float = 3.0) -> Lane:
    centre = np.array([(x, y, 0.0) for x, y in points])
    road = "" if kind == "crossing" else name
    empty = np.zeros((0, 2))
    return Lane(name, road, kind, width, 13.9, centre, empty, 0, (), (), "")


def network(*lanes: Lane, signals: tuple[SignalHead, ...] = ()) -> RoadNetwork:
    return RoadNetwork("right", (), lanes, (), signals, ())


@pytest.fixture
def extract(write_osm: Callable[..., Path]) -> Extract:
    """A street from west to east: a crossing as a node, one as a footway, a signal, a bare one."""
    nodes = {
        1: (-95, 0, {}),
        2: (-60, 0, {"highway": "crossing", "crossing": "zebra"}),
        3: (0, 0, {}),
        4: (40, 0, {"highway": "traffic_signals"}),
        5: (60, 0, {"highway": "crossing", "crossing": "no"}),
        6: (98, 0, {"highway": "crossing"}),  # at the border
        11: (0, -5, {}),
        12: (0, 5, {}),
        13: (-60.5, -5, {}),
        14: (-60.5, 5, {}),
    }
    ways = {
        1: ([1, 2, 3, 4, 5, 6], ROAD),
        2: ([11, 12], {"highway": "footway", "footway": "crossing"}),
        3: ([13, 14], {"highway": "footway", "footway": "crossing"}),  # that of node 2
    }
    return read_extract(write_osm(nodes, ways))


def test_a_crossing_counts_once_and_is_there_where_one_lies_over_its_street(
    extract: Extract,
) -> None:
    over = lane(":c", "crossing", [(-54, -4), (-54, 4)])
    found = found_of_mapped(extract, FRAME, REGION, network(over))["crossings"]
    assert (found.found, found.mapped) == (1, 2)
    assert np.allclose(found.missing, [(0, 0)], atol=0.05)
    beside = lane(":c", "crossing", [(-60, 3), (-60, 9)])  # as near, but not over the street
    assert found_of_mapped(extract, FRAME, REGION, network(beside))["crossings"].found == 0
    far = lane(":c", "crossing", [(-48, -4), (-48, 4)])
    assert found_of_mapped(extract, FRAME, REGION, network(far))["crossings"].found == 0


def test_a_street_is_there_where_lanes_lie_along_it(extract: Extract) -> None:
    for lanes, there in (
        ((lane("e", "driving", [(-95, -2), (98, -2)]),), 1),
        ((lane("e", "driving", [(-95, -2), (30, -2)]),), 0),  # of the 180 m in the region, 120
        ((lane("e", "driving", [(-95, -9), (98, -9)]),), 0),  # a street beside it
        ((lane("e", "sidewalk", [(-95, -2), (98, -2)]),), 0),
        ((), 0),
    ):
        found = found_of_mapped(extract, FRAME, REGION, network(*lanes))["streets"]
        assert (found.found, found.mapped) == (there, 1)


def test_a_signal_is_there_where_vehicles_are_stopped_near_it(extract: Extract) -> None:
    drive = lane("e", "driving", [(-90, -2), (36, -2)])
    walk = lane(":w", "crossing", [(38, -4), (38, 4)])
    head = SignalHead("p", (0,), "e", 36.0, -2.0, 0.0)
    for heads, there in (
        ((head,), 1),
        ((replace(head, x=20.0),), 0),
        ((replace(head, lane=":w", x=38.0),), 0),  # for walkers alone
        ((), 0),
    ):
        found = found_of_mapped(extract, FRAME, REGION, network(drive, walk, signals=heads))
        assert (found["signals"].found, found["signals"].mapped) == (there, 1)


def test_what_the_extract_declares_says_how_much_of_the_region_it_knows(extract: Extract) -> None:
    corners = FRAME.lonlat_from_site([[-100.0, -300.0], [50.0, 300.0]])
    (west, south), (east, north) = np.asarray(corners)
    declared = replace(extract, bounds=(west, south, east, north))
    assert share_known(declared, FRAME, REGION) == pytest.approx(0.75, abs=0.01)
    for unknown in (None, extract):  # without a map, and without bounds in it
        assert share_known(unknown, FRAME, REGION) == 1.0


def test_a_download_without_bounds_says_where_it_ends(write_osm: Callable[..., Path]) -> None:
    """Benches up to 60 m west of the middle, and a street that sticks out to the east."""
    places = np.mgrid[-260:-59:20, -100:101:20].reshape(2, -1).T
    nodes = {k + 10: (x, y, {"amenity": "bench"}) for k, (x, y) in enumerate(places)}
    nodes |= {1: (-200, 0, {}), 2: (200, 0, {})}
    half = read_extract(write_osm(nodes, {1: ([1, 2], ROAD)}))
    assert share_known(half, FRAME, REGION) == pytest.approx(50 / 200, abs=0.01)  # a rim of 10 m
    assert share_known(half, FRAME, shapely.box(-250.0, -100.0, -50.0, 100.0)) == 1.0


def test_nothing_is_mapped_without_a_map() -> None:
    assert found_of_mapped(None, FRAME, REGION, network()) == {}
