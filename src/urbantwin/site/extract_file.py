"""Reading OpenStreetMap extracts: small ones whole, large ones near the region."""

from __future__ import annotations

import gc
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import pairwise
from mmap import ACCESS_READ, mmap
from pathlib import Path

import osmium
import osmium.osm
import shapely

from urbantwin.errors import InputError, readable
from urbantwin.geometry import SiteFrame
from urbantwin.progress import Progress
from urbantwin.site.extract import Extract, Relation, Way
from urbantwin.site.large_extract import NearExtract
from urbantwin.site.map_stream import MapStream, ReadingLimits, map_size

__all__ = ["NO_NODES", "LonLatBox", "box_around", "read_extract", "without_duplicated_nodes"]


def without_duplicated_nodes(extract: Extract) -> Extract:
    """Return a map without consecutive nodes at the same position in a street.

    The first of them stays, with the tags of all; its own tags take precedence.
    """
    kept: dict[int, int] = {}

    def first(node: int) -> int:
        while node in kept:
            node = kept[node]
        return node

    position = extract.nodes.get
    for way in extract.highways():
        for a, b in pairwise(way.nodes):
            if a != b and position(a) == position(b) and position(a) and first(a) != first(b):
                kept[first(b)] = first(a)
    again = [w for w in extract.highways() if any(a == b for a, b in pairwise(w.nodes))]
    if not (kept or again):
        return extract
    found = {node: first(node) for node in kept}
    ways = dict(extract.ways)
    for way in extract.ways.values():
        nodes = [found.get(node, node) for node in way.nodes]
        once = tuple(b for k, b in enumerate(nodes) if not k or b != nodes[k - 1])
        if once != way.nodes:
            ways[way.id] = Way(way.id, once, way.tags)
    relations = {
        identity: Relation(
            identity,
            tuple((t, found.get(n, n) if t == "n" else n, role) for t, n, role in one.members),
            one.tags,
        )
        for identity, one in extract.relations.items()
    }
    tags = {node: told for node, told in extract.node_tags.items() if node not in found}
    for node, into in found.items():
        if node in extract.node_tags:
            tags[into] = {**extract.node_tags[node], **tags.get(into, {})}
    nodes_left = {node: at for node, at in extract.nodes.items() if node not in found}
    return replace(extract, nodes=nodes_left, node_tags=tags, ways=ways, relations=relations)


SUFFIXES = (".osm", ".osm.bz2", ".osm.gz", ".osm.pbf", ".pbf", ".xml")
#: Error of a map without nodes.
NO_NODES = "holds no nodes"

EXPECTED = "an OpenStreetMap extract (.osm, .osm.bz2, .osm.gz or .osm.pbf)"

#: Bytes of memory per byte of XML, for a whole map, and for the part near a place (positions of all
#: nodes, nodes of all ways); measured on 200 MB of XML.
_WHOLE, _NEAR = 2.6, 0.25

#: Margin around a region that affects it (streets, crossings, signals), metres.
_AROUND_M = 1000.0

#: Elements marked as deleted in an editor's file, and their ids (OSM wiki, "JOSM file format");
#: osmium ignores this mark.
_DELETED = re.compile(rb"""<(node|way|relation)\s[^<>]*\baction=["']delete["'][^<>]*>""")
_ID = re.compile(rb"""\bid=["'](-?\d{1,19})["']""")

#: West, south, east, north, degrees.
LonLatBox = tuple[float, float, float, float]


def box_around(frame: SiteFrame, region: shapely.Polygon) -> LonLatBox:
    """Return the box of the map that affects a region (site frame), degrees."""
    area = shapely.box(*region.buffer(_AROUND_M, quad_segs=2).bounds)
    lonlat = frame.lonlat_from_site(shapely.get_coordinates(shapely.segmentize(area, _AROUND_M)))
    (west, south), (east, north) = lonlat.min(axis=0).tolist(), lonlat.max(axis=0).tolist()
    return west, south, east, north


def read_extract(
    path: Path,
    near: LonLatBox | None = None,
    *,
    progress: Progress | None = None,
    limits: ReadingLimits | None = None,
) -> Extract:
    """Read an OpenStreetMap extract: ``.osm``, ``.osm.bz2``, ``.osm.gz`` or ``.osm.pbf``.

    Args:
        path: the file.
        near: west, south, east, north in degrees: only elements of a large file that reach into
            this box are kept, complete. If not given, the whole file, if it fits.
        progress: called with the share done (0..1) and the current task; not for small files.
        limits: limits of reading.

    Raises:
        InputError: the file is missing, truncated, not OpenStreetMap data, has no nodes, or is too
            large.
    """
    _check_name(path)
    limits = limits or ReadingLimits()
    size = map_size(path)
    whole = near is None or size * _WHOLE <= limits.small
    advice = _advice(path, near)
    needs, most = size * (_WHOLE if whole else _NEAR), limits.most_memory(whole=whole)
    if needs > most:
        raise InputError(
            f"is too much to read: {path.stat().st_size / 1e6:.0f} MB would take about "
            f"{needs / 1e9:.1f} GB of memory, of at most {most / 1e9:.1f} GB",
            file=path,
            expected=advice,
        )
    try:
        with MapStream(path, size, limits, advice, progress) as stream:
            if whole:
                with _no_collecting():
                    extract = _read_whole(path, stream)
            else:
                assert near is not None
                extract = NearExtract(path, near).read(stream)
    except (RuntimeError, ValueError, OSError, osmium.InvalidLocationError) as error:
        why = readable(str(error), 120)
        raise InputError(
            f"cannot be read as OpenStreetMap data: truncated or damaged ({why})",
            file=path,
            expected=EXPECTED,
        ) from None
    if not extract.nodes and extract.is_whole:
        raise InputError(NO_NODES, file=path, expected=EXPECTED)
    return without_duplicated_nodes(extract)


def _read_whole(path: Path, stream: MapStream) -> Extract:
    nodes: dict[int, tuple[float, float]] = {}
    node_tags: dict[int, dict[str, str]] = {}
    ways: dict[int, Way] = {}
    relations: dict[int, Relation] = {}
    deleted = _deleted(path)
    with stream.reader() as reader:
        box = reader.header().box()
        for item in stream.of(osmium.OsmFileIterator(reader)):
            if isinstance(item, osmium.osm.Changeset):
                continue
            if not item.visible or (deleted and (type(item).__name__, item.id) in deleted):
                continue
            if isinstance(item, osmium.osm.Node):
                place = item.location
                if place.valid():
                    nodes[item.id] = (place.lon, place.lat)
                    if item.tags:
                        node_tags[item.id] = dict(item.tags)
            elif isinstance(item, osmium.osm.Way):
                ways[item.id] = Way(item.id, tuple(n.ref for n in item.nodes), dict(item.tags))
            elif isinstance(item, osmium.osm.Relation):
                members = tuple((m.type, m.ref, m.role) for m in item.members)
                relations[item.id] = Relation(item.id, members, dict(item.tags))
    bounds = None
    if box.valid():
        low, high = box.bottom_left, box.top_right
        bounds = (low.lon, low.lat, high.lon, high.lat)
    return Extract(path, nodes, node_tags, ways, relations, bounds)


def _deleted(path: Path) -> frozenset[tuple[str, int]]:
    """Return type and id of the elements marked as deleted in an editor's file."""
    if not path.name.lower().endswith((".osm", ".xml")):
        return frozenset()
    with path.open("rb") as file, mmap(file.fileno(), 0, access=ACCESS_READ) as text:
        if text.find(b"action=") < 0:
            return frozenset()
        return frozenset(
            (found[1].decode().capitalize(), int(identity[1]))
            for found in _DELETED.finditer(text)
            if (identity := _ID.search(found[0]))
        )


@contextmanager
def _no_collecting() -> Iterator[None]:
    """Pause garbage collection: millions of tuples are created, and none is freed."""
    was = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()


def _check_name(path: Path) -> None:
    if not path.is_file():
        raise InputError(
            "not found" if not path.exists() else "is a folder", file=path, expected=EXPECTED
        )
    if not path.name.lower().endswith(SUFFIXES):
        raise InputError("has an unknown ending", file=path, expected=EXPECTED)
    if path.stat().st_size == 0:
        raise InputError("is empty", file=path, expected=EXPECTED)


def _advice(path: Path, near: LonLatBox | None) -> str:
    """Return advice for a map that is too large."""
    box = ",".join(f"{value:.4f}" for value in near) if near else "WEST,SOUTH,EAST,NORTH"
    return f"a smaller extract: osmium extract -b {box} {path.name} -o map.osm.pbf"
