"""Extracts: the same map in every format, features where they are, and ways cut at the border."""

import bz2
import gzip
import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import osmium
import pytest
import shapely
from pyproj import Geod

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.site import Extract, Way, read_extract

from .conftest import LATITUDE, LONGITUDE, OSM

FRAME = SiteFrame(LATITUDE, LONGITUDE)


def rows(extract: Extract) -> tuple[object, ...]:
    return (extract.nodes, extract.node_tags, extract.ways, extract.relations, extract.bounds)


def test_every_format_holds_the_same_map(shared_data: Path, tmp_path: Path) -> None:
    source = shared_data / "osm" / "West-Oakland.osm.bz2"
    plain = bz2.decompress(source.read_bytes())
    (tmp_path / "a.osm").write_bytes(plain)
    (tmp_path / "a.xml").write_bytes(plain)
    (tmp_path / "a.osm.gz").write_bytes(gzip.compress(plain))
    header = osmium.io.Reader(str(tmp_path / "a.osm")).header()
    with osmium.SimpleWriter(str(tmp_path / "a.osm.pbf"), header=header) as writer:
        for item in osmium.FileProcessor(str(tmp_path / "a.osm")):
            writer.add(item)
    first = read_extract(source)
    # The text itself, counted with a regular expression.
    assert len(first.nodes) == len(re.findall(rb"<node ", plain))
    assert len(first.ways) == len(re.findall(rb"<way ", plain))
    assert len(first.relations) == len(re.findall(rb"<relation ", plain))
    for name in ("a.osm", "a.xml", "a.osm.gz", "a.osm.pbf"):
        assert rows(read_extract(tmp_path / name)) == rows(first), name


@pytest.mark.parametrize(
    "name", ["munich.osm", "West-Oakland.osm.bz2", "taipei.osm", "quad_intersection.osm"]
)
@pytest.mark.parametrize("share", [0.3, 0.97])
def test_truncated_extract_is_refused(
    shared_data: Path, tmp_path: Path, name: str, share: float
) -> None:
    content = (shared_data / "osm" / name).read_bytes()
    path = tmp_path / name
    path.write_bytes(content[: int(len(content) * share)])
    with pytest.raises(InputError, match="truncated or damaged") as caught:
        read_extract(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_truncated_pbf_is_refused(tmp_path: Path) -> None:
    (tmp_path / "whole.osm").write_text(OSM)
    with osmium.SimpleWriter(str(tmp_path / "whole.osm.pbf")) as writer:
        for item in osmium.FileProcessor(str(tmp_path / "whole.osm")):
            writer.add(item)
    content = (tmp_path / "whole.osm.pbf").read_bytes()
    for length in (10, len(content) // 2, len(content) - 5):
        (tmp_path / "cut.osm.pbf").write_bytes(content[:length])
        with pytest.raises(InputError, match=r"cut\.osm\.pbf: "):
            read_extract(tmp_path / "cut.osm.pbf")


BAD = {
    "empty.osm": (b"", "is empty"),
    "none.osm": (b'<osm version="0.6"></osm>', "holds no nodes"),
    "html.osm": (b"<html><body>error</body></html>", "cannot be read"),
    "text.osm": (b"hello", "cannot be read"),
    "noise.osm.pbf": (bytes(range(256)) * 4, "cannot be read"),
    "noise.osm.bz2": (bytes(range(256)) * 4, "cannot be read"),
    "roads.shp": (b"hello", "unknown ending"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_is_no_extract_is_refused(tmp_path: Path, name: str) -> None:
    content, words = BAD[name]
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=words) as caught:
        read_extract(tmp_path / name)
    assert str(caught.value).startswith(str(tmp_path / name))


def test_missing_file_and_folder(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"x\.osm: not found"):
        read_extract(tmp_path / "x.osm")
    with pytest.raises(InputError, match="is a folder"):
        read_extract(tmp_path)


COURTYARD = """
  <node id="20" lat="52.5005" lon="13.4005"/><node id="21" lat="52.5005" lon="13.4015"/>
  <node id="22" lat="52.5011" lon="13.4015"/><node id="23" lat="52.5011" lon="13.4005"/>
  <node id="24" lat="52.5007" lon="13.4008"/><node id="25" lat="52.5007" lon="13.4012"/>
  <node id="26" lat="52.5009" lon="13.4012"/><node id="27" lat="52.5009" lon="13.4008"/>
  <node id="28" lat="52.5002" lon="13.4002"><tag k="natural" v="tree"/></node>
"""
RINGS = """
  <way id="30"><nd ref="20"/><nd ref="21"/><nd ref="22"/></way>
  <way id="31"><nd ref="22"/><nd ref="23"/><nd ref="20"/></way>
  <way id="32"><nd ref="24"/><nd ref="25"/><nd ref="26"/><nd ref="27"/><nd ref="24"/></way>
  <relation id="40"><member type="way" ref="30" role="outer"/>
    <member type="way" ref="31" role="outer"/><member type="way" ref="32" role="inner"/>
    <tag k="type" v="multipolygon"/><tag k="building" v="yes"/></relation>
"""


def test_features_have_their_shape_and_place(tmp_path: Path) -> None:
    text = OSM.replace('  <way id="10">', COURTYARD + '  <way id="10">')
    (tmp_path / "map.osm").write_text(text.replace("</osm>", RINGS + "</osm>"))
    extract = read_extract(tmp_path / "map.osm")
    found = {
        (item.kind, item.id): item
        for item in extract.features(FRAME, shapely.box(-5, -5, 200, 200))
    }
    assert list(found) == [("node", 28), ("way", 10), ("way", 11), ("relation", 40)]
    # A building with a courtyard: the area between two rings on the ellipsoid.
    geod = Geod(ellps="WGS84")
    rings = [[extract.nodes[n] for n in ids] for ids in ((20, 21, 22, 23), (24, 25, 26, 27))]
    outer, inner = (abs(geod.polygon_area_perimeter(*zip(*ring, strict=True))[0]) for ring in rings)
    assert found["relation", 40].geometry.area == pytest.approx(outer - inner, rel=1e-4)
    tree = found["node", 28].geometry
    azimuth, _, away = geod.inv(LONGITUDE, LATITUDE, 13.4002, 52.5002)
    assert tree.x == pytest.approx(away * np.sin(np.radians(azimuth)), abs=1e-3)
    assert tree.y == pytest.approx(away * np.cos(np.radians(azimuth)), abs=1e-3)
    # What does not touch the area is not there; what touches it is whole.
    (way,) = extract.features(FRAME, shapely.box(-150, -20, -100, 20))
    assert way.geometry.length == pytest.approx(2 * 203.7, abs=0.5)


def read_back(path: Path) -> dict[int, list[tuple[float, float]]]:
    """Read ways as plain XML."""
    root = ElementTree.parse(path).getroot()
    nodes = {n.get("id"): (float(n.get("lon")), float(n.get("lat"))) for n in root.iter("node")}
    return {
        int(way.get("id")): [nodes[nd.get("ref")] for nd in way.iter("nd")]
        for way in root.iter("way")
    }


@pytest.mark.parametrize("name", ["taipei.osm", "quad_intersection.osm", "munich.osm"])
def test_clipped_ways_are_what_lies_inside(shared_data: Path, tmp_path: Path, name: str) -> None:
    extract = read_extract(shared_data / "osm" / name)
    highways = extract.highways()
    longitude, latitude = np.median([extract.nodes[w.nodes[0]] for w in highways], axis=0)
    frame = SiteFrame(float(latitude), float(longitude))
    area = shapely.Point(0, 0).buffer(120.0)
    clipped = {piece.id: piece for piece in extract.clipped(frame, area, highways)}
    extract.write_pieces(tmp_path / "cut.osm", frame, list(clipped.values()))
    written = read_back(tmp_path / "cut.osm")
    assert written.keys() == clipped.keys()
    pieces: dict[int, list[shapely.LineString]] = {}
    for identity, lonlat in written.items():
        line = shapely.LineString(frame.site_from_lonlat(lonlat))
        assert area.buffer(0.01).contains(line)
        np.testing.assert_allclose(clipped[identity].points, line.coords, atol=1e-3)
        pieces.setdefault(clipped[identity].way, []).append(line)
    for way in highways:
        line = shapely.LineString(extract.way_line(way, frame))
        # The sum over the way's own segments, which counts a stretch that is driven twice twice.
        steps = zip(line.coords, list(line.coords)[1:], strict=False)
        inside = sum(shapely.intersection(shapely.LineString(step), area).length for step in steps)
        assert sum(piece.length for piece in pieces.get(way.id, [])) == pytest.approx(
            inside, abs=0.02
        )


def test_way_that_comes_back_becomes_two(tmp_path: Path) -> None:
    (tmp_path / "map.osm").write_text(OSM)
    extract = read_extract(tmp_path / "map.osm")
    # Two rooms on the east street with a gap between: one polygon, joined north of the street.
    rooms = shapely.union_all(
        [
            shapely.box(-100, -10, -50, 40),
            shapely.box(50, -10, 100, 40),
            shapely.box(-99, 20, 99, 40),
        ]
    )
    clipped = extract.clipped(FRAME, rooms, [extract.ways[11]])
    assert [piece.way for piece in clipped] == [11, 11]
    assert len({piece.id for piece in clipped}) == 2
    lengths = [shapely.LineString(piece.points).length for piece in clipped]
    assert lengths == pytest.approx([50.0, 50.0], abs=0.01)


def test_way_with_unknown_nodes_is_cut_without_them(tmp_path: Path) -> None:
    (tmp_path / "map.osm").write_text(OSM)
    extract = read_extract(tmp_path / "map.osm")
    ragged = Way(12, (99, 4, 98, 1, 5, 97), {"highway": "residential"})
    clipped = extract.clipped(FRAME, shapely.Point(0, 0).buffer(100), [ragged])
    lengths = [shapely.LineString(piece.points).length for piece in clipped]
    assert lengths == pytest.approx([200.0], abs=0.1)


def test_two_nodes_of_a_street_at_one_place_are_one(write_osm):
    """A cross street meets the second of them, the signal is at the first."""
    nodes = {1: (-100, 0, {}), 2: (0, 0, {"highway": "traffic_signals"}), 3: (0, 0, {"ref": "x"})}
    nodes |= {4: (100, 0, {}), 5: (0, -100, {}), 6: (0, 100, {}), 7: (0, 0, {})}
    street = {"highway": "residential"}
    ways = {10: ([1, 2, 2, 3, 4], street), 11: ([5, 3, 6], street), 12: ([7, 7], street)}
    extract = read_extract(write_osm(nodes, ways))
    assert extract.ways[10].nodes == (1, 2, 4)
    assert extract.ways[11].nodes == (5, 2, 6)
    assert extract.ways[12].nodes == (7,), "what nothing joins stays apart"
    assert extract.node_tags[2] == {"highway": "traffic_signals", "ref": "x"}


def test_what_an_editor_marked_as_deleted_is_not_read(tmp_path: Path) -> None:
    """JOSM keeps deleted elements in its files (OSM wiki, "JOSM file format")."""
    (tmp_path / "drawn.osm").write_text(
        "<osm version='0.6' upload='false' generator='JOSM'>"
        "<node id='-1' action='modify' visible='true' lat='48.7' lon='9.18'/>"
        "<node id='-2' lat='48.701' lon='9.18' action='modify'/>"
        "<node id='5' action='delete' visible='true' version='2' lat='48.7' lon='9.19'/>"
        "<node id='6' visible='false' version='2' lat='48.7' lon='9.19'/>"
        "<way id='-3' action='modify'><nd ref='-1'/><nd ref='-2'/>"
        "<tag k='highway' v='residential'/></way>"
        "<way action='delete' id='7' version='3'><nd ref='-1'/><nd ref='5'/></way></osm>"
    )
    found = read_extract(tmp_path / "drawn.osm")
    assert sorted(found.nodes) == [-2, -1]
    assert list(found.ways) == [-3]
