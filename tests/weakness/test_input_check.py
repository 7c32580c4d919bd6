"""Findings about inputs: each on a map that lacks one thing, and on real maps against a count."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import osmium
import osmium.osm
import pytest
import rasterio
import shapely
import yaml
from affine import Affine
from pyproj import Geod, Transformer

import urbantwin as ut
from urbantwin.cli import main

from ..whole_page import whole_page

EXAMPLE = Path(__file__).parents[2] / "examples" / "two-avenues"
LINK = re.compile(
    r"https://www\.openstreetmap\.org/edit\?editor=id(?:&(node|way|relation)=(\d+))?"
    r"#map=19/(-?[\d.]+)/(-?[\d.]+)"
)
Root = ElementTree.Element
Fields = dict[str, Any]
Checked = Callable[..., dict[str, dict[str, Any]]]


def elements(root: Root, kind: str, **tags: str) -> list[Root]:
    """The elements of a map that have all tags; colons are written as two underscores."""
    wanted = {(key.replace("__", ":"), value) for key, value in tags.items()}
    return [
        one
        for one in root.iter(kind)
        if wanted <= {(tag.get("k"), tag.get("v")) for tag in one.iter("tag")}
    ]


def remove_tags(root: Root, keys: str, value: str | None = None) -> None:
    for one in [*root.iter("node"), *root.iter("way"), *root.iter("relation")]:
        for tag in list(one.iter("tag")):
            if re.fullmatch(keys, tag.get("k", "")) and value in (None, tag.get("v")):
                one.remove(tag)


@pytest.fixture
def checked(tmp_path: Path) -> Checked:
    """The findings, by kind, about the example with a changed map and changed fields."""

    def run(
        change: Callable[[Root], None] = lambda _: None, **fields: Any
    ) -> dict[str, dict[str, Any]]:
        tree = ElementTree.parse(EXAMPLE / "two-avenues.osm")
        change(tree.getroot())
        tree.write(tmp_path / "map.osm", encoding="unicode")
        site = yaml.safe_load((EXAMPLE / "site.yaml").read_text())
        dem = str(EXAMPLE / "two-avenues-dem.tif")
        site |= {"osm": {**site["osm"], "file": "map.osm"}, "dem": {**site["dem"], "file": dem}}
        site |= fields
        (tmp_path / "site.yaml").write_text(
            yaml.safe_dump({key: value for key, value in site.items() if value is not None})
        )
        found = ut.site.check(tmp_path, progress=False).summary()
        json.dumps(found, allow_nan=False)
        weights = [one["weight"] for one in found["findings"]]
        assert weights == sorted(weights, reverse=True)
        return {one["kind"]: one for one in found["findings"]}

    return run


def test_a_whole_map_lacks_nothing_that_a_map_can_have(checked: Checked) -> None:
    assert set(checked()) == {"imagery-missing", "signal-programs"}


def test_a_junction_without_its_signals_looks_as_if_it_had_some(checked: Checked) -> None:
    found = checked(lambda root: remove_tags(root, "highway|crossing", "traffic_signals"))
    missing = found["signals-missing"]
    assert missing["count"] == 1
    assert missing["matters"] == "much"
    (spot,) = missing["places"]
    assert np.hypot(spot["east_m"], spot["north_m"]) < 10
    assert spot["element"].startswith("node/")
    assert "Long Avenue" in missing["problem"]
    assert "signal-programs" not in found


@pytest.mark.parametrize("value", ["stop", "give_way"])
def test_who_yields_by_sign_has_no_signals(checked: Checked, value: str) -> None:
    def signs(root: Root) -> None:
        remove_tags(root, "crossing", "traffic_signals")
        for node in elements(root, "node", highway="traffic_signals"):
            for tag in node.iter("tag"):
                tag.set("v", value)

    assert "signals-missing" not in checked(signs)


@pytest.mark.parametrize(
    ("keys", "kind"),
    [
        ("lanes.*", "lanes"),
        ("maxspeed", "maxspeed"),
        ("surface", "surface"),
        ("sidewalk", "sidewalks"),
        ("turn:lanes.*", "turn-lanes"),
    ],
)
def test_a_street_without_a_tag_is_linked(checked: Checked, keys: str, kind: str) -> None:
    def one_less(root: Root) -> None:
        (way,) = [way for way in root.iter("way") if way.get("id") == "2"]
        for tag in list(way.iter("tag")):
            if re.fullmatch(keys, tag.get("k", "")):
                way.remove(tag)

    found = checked(one_less)
    assert set(found) == {"imagery-missing", "signal-programs", kind}
    (spot,) = found[kind]["places"]
    assert spot["element"] == "way/2"
    assert "&way=2#" in spot["link"]
    assert spot["name"] == "Long Avenue"


def test_buildings_without_heights_are_counted(checked: Checked) -> None:
    def lower(root: Root) -> None:
        remove_tags(root, "height|building:height|building:levels")

    found = checked(lower)["building-heights"]
    with_building = [
        f"{one.tag}/{one.get('id')}"
        for one in ElementTree.parse(EXAMPLE / "two-avenues.osm").getroot()
        if any(tag.get("k") == "building" for tag in one.iter("tag"))
    ]
    # One of them is drawn by its parts, and found by its outline all the same.
    assert sorted(one["element"] for one in found["places"]) == sorted(with_building)
    assert found["count"] == found["of"] == len(with_building)


def test_what_the_site_has_beside_the_map_counts(checked: Checked, tmp_path: Path) -> None:
    """Heights of its file of buildings, and what a person corrected by the link of the check."""

    def weak(root: Root) -> None:
        remove_tags(root, "height|building:height|building:levels|natural|landuse")
        (way,) = [way for way in root.iter("way") if way.get("id") == "2"]
        for tag in list(way.iter("tag")):
            if tag.get("k", "").startswith("lanes"):
                way.remove(tag)

    found = checked(weak)
    root = ElementTree.parse(tmp_path / "map.osm").getroot()
    nodes = {node.get("id"): [float(node.get("lon", "")), float(node.get("lat", ""))]
             for node in elements(root, "node")}  # fmt: skip
    (first, *_) = (one for one in found["building-heights"]["places"] if "way/" in one["element"])
    (way,) = [one for one in root.iter("way") if f"way/{one.get('id')}" == first["element"]]
    ring = [nodes[one.get("ref")] for one in way.iter("nd")]
    # A small house that the map lacks, without a height.
    free = [[9.17925 + x, 48.69970 + y] for x, y in ((0, 0), (1e-4, 0), (1e-4, 7e-5), (0, 0))]
    shapes = [({"height": 12.5}, ring), ({}, free)]
    (tmp_path / "houses.geojson").write_text(json.dumps({
        "type": "FeatureCollection",
        "features": [
            {"type": "Feature", "properties": tags,
             "geometry": {"type": "Polygon", "coordinates": [line]}}
            for tags, line in shapes
        ],
    }))  # fmt: skip
    link = found["lanes"]["places"][0]["link"]
    tree = {"type": "Point", "coordinates": nodes[way.find("nd").get("ref")]}  # type: ignore[union-attr]
    (tmp_path / "corrections.geojson").write_text(json.dumps({
        "type": "FeatureCollection",
        "features": [
            {"type": "Feature", "geometry": None,
             "properties": {"action": "tag", "element": link, "tags": {"lanes": "2"}}},
            {"type": "Feature", "geometry": tree,
             "properties": {"action": "add", "what": "tree"}},
        ],
    }))  # fmt: skip
    assert {"lanes", "trees-missing"} <= set(found)
    mended = checked(weak, buildings={"file": "houses.geojson", "attribution": "a city"})
    assert ut.site.check(tmp_path, progress=False).found.attribution.endswith("; a city")
    assert not {"lanes", "trees-missing"} & set(mended)
    before = {one["element"] for one in found["building-heights"]["places"]}
    after = [one.get("element", "") for one in mended["building-heights"]["places"]]
    # No link selects a house that is in no map.
    assert sorted(after) == sorted([*(before - {first["element"]}), ""])


def test_what_is_not_there_at_all_is_said_once(checked: Checked) -> None:
    def bare(root: Root) -> None:
        remove_tags(root, "natural|landuse|power|building.*|highway", "tree")
        for keys, value in (("natural", None), ("building.*", None), ("highway", "street_lamp")):
            remove_tags(root, keys, value)
        remove_tags(root, "landuse", "forest")
        remove_tags(root, "power")

    found = checked(bare)
    assert {"trees-missing", "lamps-missing", "buildings-missing"} <= set(found)
    assert "building-heights" not in found


def test_crossings_are_missed_at_each_arm(checked: Checked) -> None:
    def uncrossed(root: Root) -> None:
        remove_tags(root, "highway", "crossing")
        remove_tags(root, "crossing.*")
        remove_tags(root, "footway", "crossing")

    found = checked(uncrossed)["crossings-missing"]
    assert (found["count"], found["of"]) == (4, 4)
    azimuths = sorted(
        np.degrees(np.arctan2(one["north_m"], one["east_m"])) % 360 for one in found["places"]
    )
    np.testing.assert_allclose(azimuths, [0, 90, 180, 270], atol=30)


def test_footways_that_do_not_meet_are_found(checked: Checked) -> None:
    """One that nothing joins, and one whose end lies half a metre beside a street."""

    def walks(root: Root) -> None:
        metre = 1 / 111_200

        def way(number: int, tags: dict[str, str], *points: tuple[float, float]) -> None:
            added = ElementTree.SubElement(root, "way", id=str(number), version="1")
            for east, north in points:
                node = str(10 * number + len(added))
                ElementTree.SubElement(
                    root, "node", id=node, version="1", lat=str(48.7 + north * metre),
                    lon=str(9.18 + east * metre / np.cos(np.radians(48.7))),
                )  # fmt: skip
                ElementTree.SubElement(added, "nd", ref=node)
            for key, value in tags.items():
                ElementTree.SubElement(added, "tag", k=key, v=value)

        way(9001, {"highway": "footway", "name": "Nowhere"}, (30, 30), (50, 30), (50, 45))
        way(9002, {"highway": "service"}, (-30, 30), (-30, 50))
        way(9003, {"highway": "footway"}, (-30, 50), (-50, 50))
        way(9004, {"highway": "footway"}, (-50, 50), (-50, 40.0))
        way(9005, {"highway": "footway"}, (-70, 40.5), (-20, 40.5))
        # What 9004 ends before; 9003 and 9004 are joined to the service road.
        ways = {one.get("id"): one for one in root.iter("way")}
        ways["9003"][0].set("ref", ways["9002"][1].get("ref", ""))
        ways["9004"][0].set("ref", ways["9003"][1].get("ref", ""))
        root[:] = sorted(root, key=lambda one: ["bounds", "node", "way", "relation"].index(one.tag))

    found = checked(walks)
    apart = {one["element"] for one in found["footways-apart"]["places"]}
    assert apart == {"way/9001", "way/9005"}
    assert [one["element"] for one in found["footway-ends"]["places"]] == ["node/90041"]


def write_raster(path: Path, cell_m: float, bands: int, **tags: str) -> str:
    """A raster about the example's anchor, 400 m wide, in UTM."""
    to_grid = Transformer.from_crs("EPSG:4326", "EPSG:32632", always_xy=True)
    east, north = to_grid.transform(9.18, 48.7)
    cells = round(400 / cell_m)
    kind: str = "uint8" if bands == 3 else "float32"
    with rasterio.open(
        path, "w", driver="GTiff", width=cells, height=cells, count=bands, dtype=kind,
        crs="EPSG:32632", transform=Affine(cell_m, 0, east - 200, 0, -cell_m, north + 200),
    ) as raster:  # fmt: skip
        raster.write(np.ones((bands, cells, cells), kind))
        raster.update_tags(**tags)
    return str(path)


def test_other_inputs_are_looked_at(checked: Checked, tmp_path: Path) -> None:
    dem = write_raster(tmp_path / "dem.tif", 20.0, 1)
    photo = write_raster(tmp_path / "photo.tif", 0.5, 3, TIFFTAG_DATETIME="2015:06:01 12:00:00")
    sensor = {"name": "a", "model": "VLP-16", "east_m": 9, "north_m": 9, "height_m": 4}

    def dated(root: Root) -> None:
        for node in root.iter("node"):
            node.set("timestamp", "2021-06-01T00:00:00Z")

    found = checked(
        dated,
        dem={"file": dem, "licence": "CC0-1.0", "attribution": "nobody"},
        imagery=[{"file": photo}],
        rig={"sensors": [{**sensor, "proposed": True}, {**sensor, "name": "b"}]},
        traffic={"per_hour": {"car": 9}, "guessed": True},
    )
    assert set(found) == {
        "dem-coarse", "imagery-coarse", "imagery-old", "sensors-proposed", "traffic-guessed",
        "licence", "signal-programs",
    }  # fmt: skip
    assert "20 m" in found["dem-coarse"]["problem"]
    assert "6.0 years" in found["imagery-old"]["problem"]
    assert "0.50 m" in found["imagery-coarse"]["problem"]
    assert "photo.tif" in found["licence"]["problem"]
    assert [one["name"] for one in found["sensors-proposed"]["places"]] == ["sensor a"]
    assert "dem-missing" in checked(dem=None)


def test_a_region_beyond_the_map_is_told(checked: Checked) -> None:
    def bounded(root: Root) -> None:
        bounds = ElementTree.Element(
            "bounds", minlat="48.6991", minlon="9.1775", maxlat="48.70125", maxlon="9.1825"
        )
        root.insert(0, bounds)

    geod, share = Geod(ellps="WGS84"), 0.0
    beyond = geod.inv(9.18, 48.7, 9.18, 48.6991)[2]  # the nearest side: 100 m to the south
    share = np.arccos(beyond / 130) / np.pi - beyond * np.sqrt(130**2 - beyond**2) / np.pi / 130**2
    found = checked(bounded)["extract-ends"]
    assert f"{100 * share:.0f} %" in found["problem"]
    assert found["places"][0]["north_m"] < -beyond


def test_pictures_pages_and_text_say_the_same(tmp_path: Path, capsys: Any) -> None:
    arguments = ["site", "check", str(EXAMPLE), "--picture", str(tmp_path / "a.png")]
    assert main([*arguments, "--page", str(tmp_path / "a.html"), "--quiet"]) == 0
    assert capsys.readouterr().out == ""
    assert main(["site", "check", str(EXAMPLE / "site.yaml")]) == 0
    text, page = capsys.readouterr().out, (tmp_path / "a.html").read_text()
    for said in ("there is no imagery", "no program of the signals"):
        assert said in text
        assert said in page
    hrefs = [attributes["href"] for tag, attributes in whole_page(page).tags if tag == "a"]
    assert all(LINK.fullmatch(href) for href in hrefs)
    assert (tmp_path / "a.png").read_bytes()[:4] == b"\x89PNG"


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["nowhere"], "nowhere: not found"),
        ([str(EXAMPLE), "--picture", "a.gif"], "a.gif: has another ending"),
        ([str(EXAMPLE), "--page", "a.png"], "a.png: has another ending"),
    ],
)
def test_bad_input_is_one_line(arguments: list[str], told: str, capsys: Any) -> None:
    assert main(["site", "check", *arguments]) == 2
    out = capsys.readouterr()
    assert out.err.startswith(f"error: {told}")
    assert out.err.count("\n") == 1
    assert out.out == ""


def assert_places_are_theirs(
    found: dict[str, Fields],
    plane: Transformer,
    ways: dict[int, tuple[dict[str, str], np.ndarray]],
    nodes: dict[int, tuple[float, float]],
) -> None:
    """Each link leads to its element, and to a place that lies on it."""
    for kind, one in found.items():
        for spot in one["places"]:
            link = LINK.fullmatch(spot["link"])
            assert link, spot
            assert spot["element"] in ("", f"{link[1]}/{link[2]}")
            here = shapely.Point(plane.transform(float(link[4]), float(link[3])))
            if spot["element"].startswith("way/"):
                shape = shapely.LineString(ways[int(link[2])][1])
                inside = shapely.convex_hull(shape).contains(here)
                assert shape.distance(here) < 0.5 or (kind == "building-heights" and inside)
            elif spot["element"].startswith("node/"):
                assert shapely.Point(nodes[int(link[2])]).distance(here) < 0.5


REAL = {
    "taipei": (25.0522385, 121.5225492),
    "chennai": (13.0716773, 80.2744307),
    "manchester-kingsway": (53.4460268, -2.3069784),
}


@pytest.mark.parametrize("name", REAL)
def test_real_maps_are_counted_right(shared_data: Path, tmp_path: Path, name: str) -> None:
    """Streets without lanes and houses without heights, way by way; signals; links."""
    latitude, longitude = REAL[name]
    path = shared_data / "osm" / f"{name}.osm"
    fields: Fields = {
        "anchor": {"latitude": latitude, "longitude": longitude},
        "region": {"radius_m": 120}, "osm": str(path),
        "rig": {"sensors": [{"name": "a", "model": "VLP-16", "east_m": 9, "north_m": 9,
                             "height_m": 4}]},
    }  # fmt: skip
    (tmp_path / "site.yaml").write_text(yaml.safe_dump(fields))
    found = {
        one["kind"]: one for one in ut.site.check(tmp_path, progress=False).summary()["findings"]
    }

    plane = Transformer.from_crs(
        "EPSG:4326", f"+proj=aeqd +lat_0={latitude} +lon_0={longitude}", always_xy=True
    )
    nodes, signals, ways = {}, [], {}
    for item in osmium.FileProcessor(str(path)):
        if isinstance(item, osmium.osm.Node) and item.location.valid():
            nodes[item.id] = plane.transform(item.location.lon, item.location.lat)
            if item.tags.get("highway") == "traffic_signals":
                signals.append(nodes[item.id])
        elif isinstance(item, osmium.osm.Way):
            refs = [node.ref for node in item.nodes if node.ref in nodes]
            ways[item.id] = (dict(item.tags), np.array([nodes[ref] for ref in refs]))
    disc = shapely.Point(0, 0).buffer(120, quad_segs=16)
    classes = "trunk primary secondary tertiary unclassified residential living_street".split()
    no_lanes, no_height = set(), set()
    for number, (tags, line) in ways.items():
        street = tags.get("highway", "").removesuffix("_link") in classes
        known = {"lanes", "lanes:forward", "lanes:backward"} & set(tags)
        if street and not known and len(line) > 1:
            no_lanes.add((f"way/{number}", shapely.LineString(line)))
        known = {"height", "building:height", "building:levels"} & set(tags)
        if tags.get("building", "no") != "no" and not known and len(line) > 3:
            no_height.add((f"way/{number}", shapely.Polygon(line)))

    def told(kind: str) -> set[str]:
        places = found.get(kind, {"places": []})["places"]
        return {one["element"] for one in places}

    assert told("lanes") == {one for one, shape in no_lanes if disc.intersects(shape)}
    houses = {one for one in told("building-heights") if one.startswith("way")}
    assert houses == {one for one, shape in no_height if disc.intersects(shape)}
    assert_places_are_theirs(found, plane, ways, nodes)
    for spot in found.get("signals-missing", {"places": []})["places"]:
        here = shapely.Point(plane.transform(spot["longitude"], spot["latitude"]))
        assert min(here.distance(shapely.Point(xy)) for xy in signals) > 40
