"""Large maps: what is near is what it would be of the whole; limits, bombs, and how far it is."""

import bz2
import gzip
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import osmium
import osmium.osm
import pytest
import shapely

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.site import read_extract
from urbantwin.site.extract_file import box_around
from urbantwin.site.map_stream import MapStream, ReadingLimits, map_size

from ..thorough import further
from .conftest import LATITUDE, LONGITUDE, OSM

#: Everything is large.
CLIPPED = ReadingLimits(small=0.0)
MAPS = ["munich.osm", "neukolln.osm", "West-Oakland.osm.bz2", "london-borough.osm"]


def sorted_copy(source: Path, target: Path) -> Path:
    """Write a map with its nodes first, then its ways, then its relations, as large ones are."""
    header = osmium.io.Reader(str(source)).header()
    with osmium.SimpleWriter(str(target), header=header) as writer:
        for kind in (osmium.osm.NODE, osmium.osm.WAY, osmium.osm.RELATION):
            for item in osmium.FileProcessor(str(source), kind):
                writer.add(item)
    return target


@pytest.mark.parametrize("name", MAPS)
@pytest.mark.parametrize("radius_m", [40.0, *further(150.0)])
def test_what_is_near_is_as_in_the_whole(
    shared_data: Path, tmp_path: Path, name: str, radius_m: float
) -> None:
    path = sorted_copy(shared_data / "osm" / name, tmp_path / "map.osm.pbf")
    whole = read_extract(path)
    longitude, latitude = np.median(list(whole.nodes.values()), axis=0)
    frame = SiteFrame(float(latitude), float(longitude))
    region = shapely.Point(0.0, 0.0).buffer(radius_m)
    # Without the kilometre around it, so that most of the map is far away.
    west, south, east, north = region.bounds
    corners = frame.lonlat_from_site([[west, south], [west, north], [east, south], [east, north]])
    near = (*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist())
    clipped = read_extract(path, near, limits=CLIPPED)
    assert not clipped.is_whole
    assert len(clipped.nodes) < len(whole.nodes) or radius_m > 100.0
    expected = whole.features(frame, region)
    found = clipped.features(frame, region)
    assert len(expected) > 3
    assert [(x.kind, x.id, x.tags) for x in found] == [(x.kind, x.id, x.tags) for x in expected]
    assert all(a.geometry.equals(b.geometry) for a, b in zip(found, expected, strict=True))
    lines = {way.id: whole.way_line(way, frame) for way in whole.highways()}
    streets = [
        way
        for way in whole.highways()
        if len(lines[way.id]) > 1 and region.intersects(shapely.LineString(lines[way.id]))
    ]
    pieces = whole.clipped(frame, region, streets)
    same = clipped.clipped(frame, region, [clipped.ways[w.id] for w in streets])
    assert [(p.id, p.way, p.nodes, p.tags) for p in same] == [
        (p.id, p.way, p.nodes, p.tags) for p in pieces
    ]
    whole.write_pieces(tmp_path / "whole.osm", frame, pieces)
    clipped.write_pieces(tmp_path / "near.osm", frame, same)
    assert (tmp_path / "near.osm").read_bytes() == (tmp_path / "whole.osm").read_bytes()


def test_an_area_around_the_region_with_all_its_ways_far_away_is_there(tmp_path: Path) -> None:
    corners = [(52.4, 13.3), (52.4, 13.5), (52.6, 13.5), (52.6, 13.3)]
    rows = [f'<node id="{100 + k}" lat="{a}" lon="{b}"/>' for k, (a, b) in enumerate(corners)]
    ways = [
        f'<way id="{50 + k}"><nd ref="{100 + k}"/><nd ref="{100 + (k + 1) % 4}"/></way>'
        for k in range(4)
    ]
    members = "".join(f'<member type="way" ref="{50 + k}" role="outer"/>' for k in range(4))
    park = (
        f'<relation id="7">{members}<tag k="type" v="multipolygon"/>'
        '<tag k="leisure" v="park"/></relation>'
    )
    text = OSM.replace('  <way id="10">', "\n".join(rows) + '\n  <way id="10">')
    text = text.replace("</osm>", "\n".join([*ways, park]) + "</osm>")
    (tmp_path / "map.osm").write_text(text)
    frame = SiteFrame(LATITUDE, LONGITUDE)
    region = shapely.Point(0, 0).buffer(50.0)
    near = read_extract(tmp_path / "map.osm", box_around(frame, region), limits=CLIPPED)
    assert ("relation", 7) in [(x.kind, x.id) for x in near.features(frame, region)]


def test_a_large_map_out_of_order_is_refused(tmp_path: Path) -> None:
    head, _, _ = OSM.partition('  <way id="10">')
    nodes = head[head.index("<node") :]
    tagged = nodes.replace("/>", "><tag k='a' v='b'/></node>")
    text = OSM.replace(nodes, "").replace("</osm>", tagged + "</osm>")
    (tmp_path / "map.osm").write_text(text)
    assert read_extract(tmp_path / "map.osm").ways
    with pytest.raises(InputError, match="osmium sort"):
        read_extract(tmp_path / "map.osm", (13.0, 52.0, 14.0, 53.0), limits=CLIPPED)


@pytest.mark.parametrize("ending", ["osm", "osm.gz", "osm.bz2"])
def test_too_much_is_said_before_it_is_read(tmp_path: Path, ending: str) -> None:
    text = OSM.encode()
    packed = {"osm.gz": gzip.compress(text), "osm.bz2": bz2.compress(text)}.get(ending, text)
    path = tmp_path / f"map.{ending}"
    path.write_bytes(packed)
    assert map_size(path) == len(text)
    with pytest.raises(InputError, match="is too much to read") as caught:
        read_extract(path, limits=ReadingLimits(memory=len(text)))
    assert "osmium extract -b WEST,SOUTH,EAST,NORTH" in str(caught.value)
    assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match=r"-b 13\.0000,52\.0000,14\.0000,53\.0000"):
        read_extract(path, (13.0, 52.0, 14.0, 53.0), limits=ReadingLimits(memory=1.0))
    assert read_extract(path, limits=ReadingLimits(memory=4.0 * len(text))).nodes


@pytest.mark.parametrize(
    ("start", "pack"),
    [
        ("honest", gzip.compress),
        *further(("", gzip.compress), ("", bz2.compress), ("honest", bz2.compress)),
    ],
)
def test_a_file_that_unpacks_without_end_is_stopped(
    tmp_path: Path, pack: Callable[[bytes], bytes], start: str
) -> None:
    head, _, tail = OSM.partition("<node")
    honest = head + "<node" + tail.replace("</osm>", "")
    blank = b" " * (64 << 20)
    ending = "gz" if pack is gzip.compress else "bz2"
    path = tmp_path / f"bomb.osm.{ending}"
    path.write_bytes(pack((honest if start else head).encode()) + pack(blank) + pack(b"</osm>"))
    assert path.stat().st_size < 1 << 18
    limits = ReadingLimits(memory=8e9, whole=8e9)
    with pytest.raises(InputError, match="unpacks to far more than its size suggests"):
        read_extract(path, limits=limits)


def test_how_far_it_is_and_how_long_yet(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "map.osm.gz"
    path.write_bytes(bytes(32 << 20))  # not packed at all, and the worker copies it
    # A second passes between any two looks at the clock.
    clock = iter(range(10**9))
    monkeypatch.setattr("urbantwin.site.map_stream.time.monotonic", lambda: float(next(clock)))

    def told(limits: ReadingLimits) -> Iterator[tuple[float, str]]:
        found: list[tuple[float, str]] = []

        def tell(share: float, doing: str) -> None:
            found.append((share, doing))

        with MapStream(path, 32 << 20, limits, "less", tell) as stream:
            copied = stream.bytes
            assert copied is not None
            for _ in stream.of(iter(lambda: copied.read(2048), b"")):  # type: ignore[arg-type]
                yield from found
                found.clear()

    every = list(told(ReadingLimits()))
    shares = [share for share, _ in every]
    assert len(shares) > 50
    assert shares == sorted(shares)
    assert shares[0] < 0.1
    assert shares[-1] > 0.9
    assert all(doing.startswith("reading the map") for _, doing in every)
    seconds = [int(doing.split()[-3]) for _, doing in every if doing.endswith(" s left")]
    assert len(seconds) > 40
    # At an even pace what is left is what comes yet: one second a look.
    half = len(shares) // 2
    assert int(every[half][1].split()[-3]) == pytest.approx(len(shares) - half, abs=15)
    with pytest.raises(InputError, match=r"would take .* minutes to read"):
        list(told(ReadingLimits(seconds=2.0)))


def test_the_unpacker_is_gone_after_an_error(tmp_path: Path) -> None:
    path = tmp_path / "map.osm.gz"
    packed = gzip.compress(OSM.encode())
    path.write_bytes(packed[: len(packed) // 2])
    before = children()
    with pytest.raises(InputError, match="truncated or damaged"):
        read_extract(path)
    assert children() <= before


def children() -> set[str]:
    """Return the processes that this one has started and that are still there (Linux)."""
    told = Path("/proc/self/task").glob("*/children")
    return {number for one in told for number in one.read_text().split()}
