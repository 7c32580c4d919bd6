"""Guessed traffic: room on the road is kept, countries differ as they do, ends of maps lead in."""

from collections.abc import Callable
from pathlib import Path

import pytest
import shapely

from urbantwin.geometry import SiteFrame
from urbantwin.site import read_extract
from urbantwin.site.extract import OsmFeature
from urbantwin.site.traffic_around import lanes_leading_in, per_hour_around, walkers_around
from urbantwin.site.usual_traffic import LANE_PER_HOUR, usual_per_hour

FRAME = SiteFrame(48.7, 9.18)
REGION = shapely.Point(0, 0).buffer(150)


def four_arms(length: float, tags: dict[str, str]) -> tuple[dict, dict]:
    """A crossing of two streets, whose four arms are so long."""
    ends = {1: (-length, 0), 2: (length, 0), 3: (0, -length), 4: (0, length)}
    nodes = {5: (0, 0, {}), **{k: (x, y, {}) for k, (x, y) in ends.items()}}
    return nodes, {10: ((1, 5, 2), tags), 11: ((3, 5, 4), tags)}


@pytest.mark.parametrize("length", [60.0, 140.0, 400.0])
def test_lanes_lead_in_though_the_extract_ends_inside_the_region(
    write_osm: Callable[..., Path], length: float
) -> None:
    osm = write_osm(*four_arms(length, {"highway": "primary", "lanes": "4"}))
    assert lanes_leading_in(read_extract(osm), FRAME, REGION) == {"primary": 8.0}


def test_a_cul_de_sac_does_not_lead_in(write_osm: Callable[..., Path]) -> None:
    nodes, ways = four_arms(400.0, {"highway": "secondary", "lanes": "2"})
    nodes[6] = (70, 60, {})
    nodes[7] = (70, 0, {})
    ways[10] = ((1, 5, 7, 2), ways[10][1])
    ways[12] = ((7, 6), {"highway": "residential"})
    found = lanes_leading_in(read_extract(write_osm(nodes, ways)), FRAME, REGION)
    assert found == {"secondary": 4.0}


def test_a_village_has_less_traffic_than_a_junction_of_arterials() -> None:
    village = usual_per_hour({"residential": 20.0, "unclassified": 4.0}, country="BR")
    arterials = usual_per_hour({"primary": 12.0}, country="US")
    assert sum(village.values()) < 1000
    assert arterials["car"] > 2000
    assert sum(usual_per_hour({"service": 1.0}).values()) >= 50


def test_motorcycles_take_the_place_of_cars() -> None:
    lanes = {"secondary": 8.0}
    cars = LANE_PER_HOUR["secondary"] * 8
    for country in ("", "DE", "IN", "VN", "JP"):
        found = usual_per_hour(lanes, country=country)
        room = found["car"] + found["van"] + found["truck"] + 0.4 * found["motorcycle"]
        assert room == pytest.approx(cars, rel=0.02), country
    chennai, hanoi, leeds = (usual_per_hour(lanes, country=c) for c in ("IN", "VN", "GB"))
    assert hanoi["motorcycle"] > chennai["motorcycle"] > chennai["car"]
    assert leeds["motorcycle"] < 0.05 * leeds["car"]
    dutch = usual_per_hour(lanes, country="NL")
    assert dutch["bicycle"] > 5 * leeds["bicycle"]


def test_buses_come_by_the_lines_that_are_mapped(write_osm: Callable[..., Path]) -> None:
    assert usual_per_hour({"primary": 8.0}, bus_lines=5)["bus"] == 20
    assert usual_per_hour({"primary": 8.0})["bus"] == 0
    nodes, ways = four_arms(400.0, {"highway": "primary", "lanes": "4"})
    osm = write_osm(nodes, ways)
    line = '<member type="way" ref="10" role=""/><tag k="type" v="route"/><tag k="route" v="{}"/>'
    text = osm.read_text()
    for number, route in enumerate(("bus", "trolleybus", "hiking")):
        relation = f'<relation id="{number + 1}" version="1">{line.format(route)}</relation>'
        text = text.replace("</osm>", f"{relation}</osm>")
    osm.write_text(text)
    assert per_hour_around(read_extract(osm), FRAME, REGION)["bus"] == 8


def test_people_walk_where_there_is_something_to_walk_to() -> None:
    def feature(size: float = 0.0, **tags: str) -> OsmFeature:
        return OsmFeature("way", 1, tags, shapely.box(0, 0, size, size))

    houses = [feature(10.0, building="house")] * 30
    shops = [feature(shop="bakery"), feature(amenity="cafe")] * 10
    station = [feature(railway="station")]
    assert walkers_around([]) <= walkers_around(houses) < walkers_around(houses + shops)
    assert walkers_around(houses + shops) < walkers_around(houses + shops + station)


def test_real_places_differ_as_they_do(shared_data: Path) -> None:
    def guessed(name: str, latitude: float, longitude: float) -> dict[str, int]:
        extract = read_extract(shared_data / "osm" / name)
        return per_hour_around(extract, SiteFrame(latitude, longitude), REGION)

    chennai = guessed("chennai.osm", 13.0717, 80.2744)
    munich = guessed("munich.osm", 48.1860, 11.5517)
    assert chennai["motorcycle"] > 2 * chennai["car"]
    assert munich["motorcycle"] < 0.1 * munich["car"]
    assert munich["bicycle"] > 100
    assert chennai["bus"] > 0
    assert munich["bus"] > 0
