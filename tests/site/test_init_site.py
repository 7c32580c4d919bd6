"""A first ``site.yaml``: at real places, where one would put it, and nowhere else."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import shapely
from pyproj import Geod

from urbantwin.errors import InputError
from urbantwin.interface.whole_line import helsinki_extract
from urbantwin.site import check_extract, init_site, load_site, propose_junction, read_extract

from .conftest import OSM

EXTRACTS = [
    "taipei.osm",
    "neukolln.osm",
    "quad_intersection.osm",
    "perth_stretched_lights.osm",
    "munich.osm",
    "West-Oakland.osm.bz2",
]
#: Half the width of the narrowest street that carries both directions, metres.
HALF_STREET_M = 2.5
STREETS = ("primary", "secondary", "tertiary", "trunk", "residential", "unclassified")


@pytest.fixture(scope="module", params=EXTRACTS)
def made(
    request: pytest.FixtureRequest, shared_data: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, Path]:
    """Return an extract of a real place and the site.yaml that was written for it."""
    source = shared_data / "osm" / request.param
    return source, init_site(tmp_path_factory.mktemp("site") / "here", source)


def test_real_extract_gives_a_site_at_signals(made: tuple[Path, Path]) -> None:
    source, path = made
    site = load_site(path)
    extract = read_extract(source)
    check_extract(site, extract)
    signals = [
        Geod(ellps="WGS84").inv(site.longitude, site.latitude, *extract.nodes[node])[2]
        for node, tags in extract.node_tags.items()
        if tags.get("highway") == "traffic_signals"
    ]
    assert min(signals) < 40.0
    boundary = source.parent / f"{source.name.split('.')[0]}.boundary.json"
    if boundary.exists():
        ring = json.loads(boundary.read_text())["features"][0]["geometry"]["coordinates"][0]
        inside = shapely.Polygon(ring).contains(shapely.Point(site.longitude, site.latitude))
    else:
        west, south, east, north = extract.bounds or (0, 0, 0, 0)
        inside = west < site.longitude < east and south < site.latitude < north
    assert inside


def test_no_crossing_lies_on_the_border_of_a_real_region(made: tuple[Path, Path]) -> None:
    source, path = made
    site, extract = load_site(path), read_extract(source)
    driven = {n for way in extract.highways() if way.tags["highway"] in STREETS for n in way.nodes}
    away = [
        Geod(ellps="WGS84").inv(site.longitude, site.latitude, *extract.nodes[node])[2]
        for node, tags in extract.node_tags.items()
        if tags.get("highway") in ("crossing", "traffic_signals") and node in driven
    ]
    assert min(abs(distance - site.radius_m) for distance in away) > 3.5


def test_real_sensor_stands_beside_the_street_and_looks_at_the_junction(
    made: tuple[Path, Path],
) -> None:
    source, path = made
    site = load_site(path)
    sensor = site.rig.sensors[0]
    place = np.array([sensor.east_m, sensor.north_m])
    assert 10.0 <= np.linalg.norm(place) <= 30.0
    assert 5.0 <= sensor.height_m <= 6.0
    assert sensor.pitch_deg > 0  # down, as in REP-103
    heading = np.array([np.cos(np.radians(sensor.yaw_deg)), np.sin(np.radians(sensor.yaw_deg))])
    assert heading @ -place / np.linalg.norm(place) > np.cos(np.radians(1.0))
    around = shapely.Point(place).buffer(40.0)
    streets = 0
    for item in read_extract(source).features(site.frame, around):
        away = shapely.distance(item.geometry, shapely.Point(place))
        if "building" in item.tags and "Polygon" in item.geometry.geom_type:
            assert away > 0.5, item
        elif item.tags.get("highway") in STREETS:
            assert away > HALF_STREET_M, item
            streets += 1
    assert streets >= 2


@pytest.mark.parametrize("name", ["perth_stretched_lights.osm", "West-Oakland.osm.bz2"])
def test_real_site_is_the_same_each_time_and_holds_all_it_needs(
    shared_data: Path, tmp_path: Path, name: str
) -> None:
    source = shared_data / "osm" / name
    path = init_site(tmp_path / "first", source)
    again = init_site(tmp_path / "again", source)
    assert again.read_bytes() == path.read_bytes()
    shutil.move(again.parent, tmp_path / "moved")
    site = load_site(tmp_path / "moved" / "site.yaml")
    assert site.osm.path.parent == tmp_path / "moved"
    assert site.osm.path.read_bytes() == source.read_bytes()
    assert "OpenStreetMap contributors" in site.inputs()[0]["attribution"]


def test_helsinki_of_the_demo(tmp_path: Path) -> None:
    path = init_site(tmp_path, helsinki_extract())
    assert 60.164 < load_site(path).latitude < 60.18


@pytest.fixture
def crossing(tmp_path: Path) -> Path:
    path = tmp_path / "map.osm"
    path.write_text(OSM)
    return path


def test_extract_in_the_folder_is_not_copied(crossing: Path) -> None:
    init_site(crossing.parent, crossing)
    assert sorted(p.name for p in crossing.parent.iterdir()) == ["map.osm", "site.yaml"]


def test_given_place_is_taken(crossing: Path, tmp_path: Path) -> None:
    path = init_site(tmp_path, crossing, latitude=52.5005, longitude=13.4, radius_m=80)
    site = load_site(path)
    assert (site.latitude, site.longitude, site.radius_m) == (52.5005, 13.4, 80.0)
    # East Street is 55 m away.
    assert site.name == "North Street"


def test_given_region_is_taken_and_comes_along(crossing: Path, tmp_path: Path) -> None:
    ring = [[13.398, 52.499], [13.402, 52.499], [13.4, 52.502], [13.398, 52.499]]
    region = tmp_path / "region.geojson"
    region.write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    path = init_site(tmp_path / "site", crossing, region=region)
    assert sorted(p.name for p in path.parent.iterdir()) == [
        "map.osm",
        "region.geojson",
        "site.yaml",
    ]
    site = load_site(path)
    assert len(shapely.get_coordinates(site.region)) == 4
    region.write_text(
        json.dumps({"type": "Polygon", "coordinates": [[[x, y + 0.0015] for x, y in ring]]})
    )
    with pytest.raises(InputError, match=r"map\.osm: has no junction in the region"):
        init_site(tmp_path / "beside", crossing, region=region)


BAD_PLACES = {
    "overseas": ({"latitude": 0.0, "longitude": -90.0}, r"is \d+ km from the extract; expected la"),
    "next town": ({"latitude": 52.6, "longitude": 13.4}, "is 11 km from the extract"),
    "half a place": ({"latitude": 52.5}, "go together"),
    "no latitude": ({"latitude": 95.0, "longitude": 13.4}, "latitude 95 is out of range"),
    "not a number": ({"latitude": float("nan"), "longitude": 13.4}, "out of range"),
    "a field": (
        {"latitude": 52.5005, "longitude": 13.4005, "radius_m": 20.0},
        r"has no road within the region: the nearest is 1[34] m away from it",
    ),
    "no radius": ({"radius_m": 0.0}, "the radius is 0 m; expected 20 to 2000"),
    "radius nan": ({"radius_m": float("nan")}, "expected 20 to 2000"),
    "huge": ({"radius_m": 1e5}, "expected 20 to 2000"),
}


@pytest.mark.parametrize(("given", "words"), BAD_PLACES.values(), ids=BAD_PLACES.keys())
def test_bad_place_is_refused_and_nothing_is_left(
    crossing: Path, tmp_path: Path, given: dict[str, float], words: str
) -> None:
    with pytest.raises(InputError, match=words):
        init_site(tmp_path / "new", crossing, **given)
    assert not (tmp_path / "new").exists()


def test_nothing_of_somebody_is_overwritten(crossing: Path, tmp_path: Path) -> None:
    folder = tmp_path / "mine"
    path = init_site(folder, crossing)
    path.write_text("mine")
    with pytest.raises(InputError, match=r"site\.yaml: is there already; expected .*--force"):
        init_site(folder, crossing)
    assert path.read_text() == "mine"
    init_site(folder, crossing, force=True)
    assert load_site(path).name == "East Street / North Street"
    path.unlink()
    (folder / "map.osm").write_text("mine")
    with pytest.raises(InputError, match=r"map\.osm: differs from"):
        init_site(folder, crossing)
    assert (folder / "map.osm").read_text() == "mine"
    with pytest.raises(InputError, match="is a file; expected a folder"):
        init_site(crossing, crossing)


@pytest.mark.parametrize(
    "name", ['a "quoted" # name: x', "two\\nlines", "中山 😀", "- {[", "é\u200b"]
)
def test_any_street_name_survives(tmp_path: Path, name: str) -> None:
    from xml.sax.saxutils import escape

    written = escape(name, {'"': "&quot;"})
    (tmp_path / "map.osm").write_text(OSM.replace("East Street", written), encoding="utf-8")
    site = load_site(init_site(tmp_path, tmp_path / "map.osm"))
    assert site.name in (f"North Street / {name}", f"{name} / North Street")


def grid(north: float, highway: str, *, buildings: int, first: int, signal: bool) -> str:
    """Two crossing streets at a latitude, with buildings in the corners, as OSM XML."""
    tag = '<tag k="highway" v="traffic_signals"/>' if signal else ""
    text = f'<node id="{first}" lat="{north}" lon="13.4">{tag}</node>'
    ends = [(0.002, 0.0), (-0.002, 0.0), (0.0, 0.003), (0.0, -0.003)]
    for number, (dy, dx) in enumerate(ends, first + 1):
        text += f'<node id="{number}" lat="{north + dy}" lon="{13.4 + dx}"/>'
    for way in (0, 1):
        a, b = first + 1 + 2 * way, first + 2 + 2 * way
        text += f'<way id="{first + way}"><nd ref="{a}"/><nd ref="{first}"/><nd ref="{b}"/>'
        text += f'<tag k="highway" v="{highway}"/></way>'
    for number in range(buildings):
        # Houses in four rows around the crossing, each of 7 m x 11 m.
        y = north + 0.0003 * (1 + number % 2) * (1 if number % 4 < 2 else -1)
        x = 13.4 + 0.0004 * (1 + number // 8) * (1 if number % 8 < 4 else -1)
        node = first + 100 + 10 * number
        for i, (dy, dx) in enumerate([(0, 0), (0, 1e-4), (1e-4, 1e-4), (1e-4, 0)]):
            text += f'<node id="{node + i}" lat="{y + dy}" lon="{x + dx}"/>'
        refs = "".join(f'<nd ref="{node + i}"/>' for i in (0, 1, 2, 3, 0))
        text += f'<way id="{node}">{refs}<tag k="building" v="yes"/></way>'
    return text


def written(path: Path, *parts: str) -> Path:
    # OSM files list their nodes first.
    import re

    body = "".join(parts)
    nodes = "".join(re.findall(r"<node[^>]*/>|<node[^>]*>.*?</node>", body))
    ways = "".join(re.findall(r"<way.*?</way>", body))
    path.write_text(f'<osm version="0.6">{nodes}{ways}</osm>', encoding="utf-8")
    return path


def test_busy_crossing_in_the_sparse_outskirts_does_not_win(tmp_path: Path) -> None:
    town = grid(52.5, "tertiary", buildings=24, first=1000, signal=True)
    outskirts = grid(52.52, "secondary", buildings=0, first=9000, signal=True)
    found = propose_junction(read_extract(written(tmp_path / "a.osm", town, outskirts)))
    assert found.latitude == pytest.approx(52.5, abs=1e-5)
    assert found.signals == 1


def test_among_equals_the_larger_streets_win(tmp_path: Path) -> None:
    quiet = grid(52.5, "residential", buildings=24, first=1000, signal=True)
    busy = grid(52.501, "primary", buildings=24, first=9000, signal=True)
    found = propose_junction(read_extract(written(tmp_path / "a.osm", quiet, busy)))
    assert found.latitude == pytest.approx(52.501, abs=1e-5)


def test_signals_are_preferred_and_their_absence_is_said(tmp_path: Path) -> None:
    plain = grid(52.5, "primary", buildings=24, first=1000, signal=False)
    lights = grid(52.501, "residential", buildings=24, first=9000, signal=True)
    found = propose_junction(read_extract(written(tmp_path / "a.osm", plain, lights)))
    assert found.signalised
    assert found.latitude == pytest.approx(52.501, abs=1e-5)
    found = propose_junction(read_extract(written(tmp_path / "b.osm", plain)))
    assert not found.signalised
    assert found.arms == 4
    path = init_site(tmp_path / "site", tmp_path / "b.osm")
    assert "no signals in this extract" in path.read_text()


def test_one_street_without_a_junction(tmp_path: Path) -> None:
    text = OSM[: OSM.index('<way id="11"')] + "</osm>"
    (tmp_path / "map.osm").write_text(text)
    site = load_site(init_site(tmp_path, tmp_path / "map.osm"))
    assert site.latitude == pytest.approx(52.5, abs=1e-5)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"highway"', '"waterway"', "holds no roads"),
        ('"residential"', '"footway"', "holds paths and service roads but no streets"),
    ],
)
def test_extract_without_streets_is_refused(tmp_path: Path, old: str, new: str, words: str) -> None:
    (tmp_path / "map.osm").write_text(OSM.replace(old, new))
    with pytest.raises(InputError, match=words):
        init_site(tmp_path / "new", tmp_path / "map.osm")
    assert not (tmp_path / "new").exists()


def test_a_junction_is_named_after_all_its_streets(shared_data, tmp_path):
    """Three streets meet at this ring, none of them a side street."""
    site = load_site(init_site(tmp_path / "s", shared_data / "osm" / "montlake_roundabout.osm"))
    assert set(site.name.split(" / ")) == {
        "22nd Avenue East",
        "23rd Avenue East",
        "East Lynn Street",
    }
