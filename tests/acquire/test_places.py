"""Where a place is: coordinates as people write them, and names of streets and towns."""

from urllib.parse import parse_qs, urlsplit

import pytest

from urbantwin.acquire import (
    AnswerCache,
    Area,
    SourceSpec,
    Web,
    chosen_sources,
    find_place,
    parse_place,
    sources_of,
)
from urbantwin.errors import InputError

from .local_web import known_place, nominatim, send
from .made_world import LATITUDE, LONGITUDE, row


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("48.1374,11.5755", (48.1374, 11.5755)),
        (" -33.86 , 151.21 ", (-33.86, 151.21)),
        ("48.1374 11.5755", (48.1374, 11.5755)),
        ("48.1374°, 11.5755°", (48.1374, 11.5755)),
        ("+1,-2.", (1.0, -2.0)),
    ],
)
def test_coordinates_are_read_as_people_write_them(text, place):
    assert parse_place(text) == place


@pytest.mark.parametrize("text", ["48.1", "48,1374,11,5755", "north,east", "1e5,3", "", "nan,1"])
def test_what_are_no_coordinates_is_told(text):
    with pytest.raises(InputError, match=r"--at: is .* expected LAT,LON"):
        parse_place(text)


@pytest.mark.parametrize(
    ("place", "radius", "told"),
    [
        # Latitude and longitude swapped, of towns on four continents: out of range, or in the sea.
        ((139.70, 35.66), 150, "out of range; expected latitude first: --at 35.66,139.7"),
        ((11.5755, 48.1374), 150, "in the sea; expected latitude first: --at 48.1374,11.5755"),
        ((-118.24, 34.05), 150, "out of range; expected latitude first: --at 34.05,-118.24"),
        ((-43.2, -22.9), 150, "in the sea; expected latitude first: --at -22.9,-43.2"),
        ((45.0, -40.0), 150, "in the sea; expected a place on land"),
        ((200.0, 300.0), 150, "out of range; expected LAT,LON"),
        ((89.5, 10.0), 150, "near a pole"),
        ((48.1, 11.6), 19, "--radius: is 19 m; expected 20 to 2000 m"),
        ((48.1, 11.6), 2001, "--radius: is 2001 m"),
        ((48.1, 11.6), float("nan"), "--radius: is nan m"),
    ],
)
def test_a_place_where_no_site_can_be_is_told(place, radius, told):
    with pytest.raises(InputError) as caught:
        Area.checked(*place, radius)
    assert told in str(caught.value)


@pytest.mark.parametrize(
    "place",
    [(48.1374, 11.5755), (35.66, 139.70), (-33.8568, 151.2153), (37.8199, -122.4783),
     (52.0, 4.35), (25.04, 121.56), (13.08, 80.29), (1.2840, 103.8607), (51.5007, -0.1246)],
)  # fmt: skip
def test_towns_by_the_water_are_not_in_the_sea(place):
    assert Area.checked(*place, 150.0).latitude == place[0]


@pytest.fixture
def look_up(server, tmp_path):
    """``look_up(text)``: what a name means to a Nominatim that knows a few towns."""
    server.answers["/search"] = nominatim(
        {
            "stuttgart": [known_place(LATITUDE, LONGITUDE, "Stuttgart, Germany"),
                          known_place(LATITUDE + 0.01, LONGITUDE, "Stuttgart (middle)")],
            "springfield": [known_place(39.80, -89.64, "Springfield, Illinois"),
                            known_place(42.10, -72.59, "Springfield, Massachusetts"),
                            known_place(37.21, -93.29, "Springfield, Missouri")],
            "two": [known_place(10.0, 10.0, "Two, elsewhere"),
                    known_place(LATITUDE, LONGITUDE, "Two, here")],
            "long avenue 7, stuttgart": [known_place(48.7011, 9.1803, "Long Avenue 7", 1e-4)],
        }
    )  # fmt: skip
    table = [row(server, "osm", "map", "overpass", "/api/interpreter"),
             row(server, "names", "names", "nominatim", "/search")]  # fmt: skip
    specs = [SourceSpec.model_validate(one) for one in table]

    def found(text):
        return find_place(text, specs, Web(AnswerCache(tmp_path / "cache"), environment={}))

    return found


@pytest.mark.parametrize(
    "text",
    ["Long Avenue and Cross Street, Stuttgart", "cross st & LONG AVE, Stuttgart",
     "Long Avenue/Cross Street,Stuttgart", "Cross Street und Long Avenue, Two"],
)  # fmt: skip
def test_two_streets_mean_where_they_meet(look_up, text):
    place = look_up(text)
    assert (place.latitude, place.longitude) == pytest.approx((LATITUDE, LONGITUDE), abs=2e-4)


def test_an_address_means_its_place(look_up):
    assert look_up("Long Avenue 7, Stuttgart").latitude == 48.7011


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("Springfield", ["means 3 places", "39.80000,-89.64000 (Springfield, Illinois)",
                         "Missouri", "expected one of them: --at LAT,LON"]),
        ("Atlantis", ["'Atlantis' is not found"]),
        ("Long Avenue and Cross Street, Atlantis", ["no town 'Atlantis' is known"]),
        ("Long Avenue and Broadway, Stuttgart", ["do not meet in Stuttgart, Germany"]),
        ("Main Street and Elm Street, Springfield", ["do not meet in Springfield, Illinois nor"]),
        ("x", ["is no name of a place"]),
    ],
)  # fmt: skip
def test_a_name_without_one_place_is_told_in_one_line(look_up, text, told):
    with pytest.raises(InputError) as caught:
        look_up(text)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith("--place: ")
    for one in told:
        assert one in str(caught.value)


def test_names_hold_no_instructions_for_overpass(look_up, server):
    server.answers["/api/interpreter"] = lambda handler: send(handler, b'{"elements": []}')
    with pytest.raises(InputError, match="do not meet"):
        look_up('A"];out;way["x and B.*, Stuttgart')
    (query,) = (parse_qs(urlsplit(path).query)["data"][0] for path, _ in server.asked
                if path.startswith("/api"))  # fmt: skip
    assert r'~"^A\"\\];out;way\\[\"x",i]' in query
    assert r'~"^B\\.\\*",i]' in query


def test_names_are_asked_for_once(look_up, server):
    look_up("Long Avenue and Cross Street, Stuttgart")
    asked = len(server.asked)
    look_up("Long Avenue and Cross Street, Stuttgart")
    assert len(server.asked) == asked == 2


@pytest.mark.parametrize(
    ("place", "countries"),
    [((48.137, 11.575), set()), ((47.80, 13.04), {"basemap-at-orthofoto"}),
     ((47.55, 9.68), set()), ((47.56, 7.59), {"swissimage", "swissalti3d"}),
     ((52.0, 4.36), {"ahn", "pdok-luchtfoto"}), ((50.775, 6.08), {"nrw-dgm"}),
     ((48.57, 7.75), {"ign-ortho", "ign-lidar-hd"}), ((48.57, 7.82), set()),
     ((42.335, -83.045), {"usgs-3dep", "usgs-3dep-10m", "usgs-3dep-lidar"}),
     ((42.30, -83.03), set()), ((-33.86, 151.2), set())],
)  # fmt: skip
def test_national_sources_are_asked_in_their_country_alone(place, countries):
    """On both sides of borders that run through towns."""
    area = Area.checked(*place, 150.0)
    asked = {one.spec.name for one in sources_of(chosen_sources()) if one.covers(area)}
    world = {"openstreetmap", "overture-buildings", "copernicus-glo-30", "terrain-tiles"}
    assert asked == world | countries
