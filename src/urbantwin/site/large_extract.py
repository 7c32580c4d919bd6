"""Reading the part of a large extract near a place, in one pass."""

from __future__ import annotations

from array import array
from pathlib import Path

import numpy as np
import osmium
import osmium.filter
import osmium.index
import osmium.osm
from numpy.typing import NDArray
from osmium.osm.types import Node as OsmNode
from osmium.osm.types import Relation as OsmRelation
from osmium.osm.types import Way as OsmWay

from urbantwin.errors import InputError
from urbantwin.site.extract import Extract, Relation, Way
from urbantwin.site.map_stream import MapStream

__all__ = ["NearExtract"]

#: Scale of osmium's integer coordinates (1e-7 degrees) and their largest valid values. osmium
#: returns the largest integer for unknown nodes.
_SCALE, _MOST_X, _MOST_Y = 1e7, 1_800_000_000, 900_000_000
_NOWHERE = 2_147_483_647
#: Relations that are used: areas, and turn restrictions.
_AREAS, _TURNS = ("multipolygon", "building"), "restriction"

_Box = tuple[float, float, float, float]


class NearExtract:
    """Reads a map in one pass and keeps all elements that reach into a box, complete.

    Kept are: nodes with tags in the box; ways and areas whose bounds intersect it, with all their
    nodes; turn restrictions with a kept way. For all others, osmium keeps the positions of nodes
    (16 bytes each), and this class the nodes of ways (8 bytes each), because an area that reaches
    into the box may have ways far away.

    Args:
        path: the map.
        near: west, south, east, north in degrees.
    """

    def __init__(self, path: Path, near: _Box) -> None:
        west, south, east, north = (round(value * _SCALE) for value in near)
        self._path = path
        self._west, self._south, self._east, self._north = west, south, east, north
        self._places = osmium.index.create_map("flex_mem")
        self._nodes: dict[int, tuple[float, float]] = {}
        self._node_tags: dict[int, dict[str, str]] = {}
        self._ways: dict[int, Way] = {}
        self._relations: dict[int, Relation] = {}
        self._last_node = self._last_relation = 0
        # All ways: id, bounds, and their nodes' ids in one array.
        self._way_ids, self._refs, self._firsts = array("q"), array("q"), array("q", [0])
        self._bounds = array("i")
        self._order: NDArray[np.int64] | None = None

    def read(self, stream: MapStream) -> Extract:
        """Read the map.

        Raises:
            InputError: nodes, ways and relations are not in this order, or have negative ids.
            RuntimeError: the file cannot be read.
        """
        places = osmium.NodeLocationsForWays(self._places)
        places.ignore_errors()
        tagged = osmium.filter.EmptyTagFilter()
        tagged.enable_for(osmium.osm.NODE)
        with stream.reader() as reader:
            box = reader.header().box()
            for item in stream.of(osmium.OsmFileIterator(reader, places, tagged)):
                if isinstance(item, OsmNode):
                    self._add_node(item)
                elif isinstance(item, OsmWay):
                    self._add_way(item)
                elif isinstance(item, OsmRelation):
                    self._add_relation(item)
        bounds = None
        if box.valid():
            low, high = box.bottom_left, box.top_right
            bounds = (low.lon, low.lat, high.lon, high.lat)
        last_way = max(self._way_ids, default=0)
        return Extract(
            self._path,
            self._nodes,
            self._node_tags,
            self._ways,
            self._relations,
            bounds,
            (self._last_node, last_way, self._last_relation),
            is_whole=False,
        )

    def _add_node(self, node: OsmNode) -> None:
        if self._way_ids or node.id < 0:
            raise self._out_of_order()
        self._last_node = max(self._last_node, node.id)
        place = node.location
        if not place.valid():
            return
        if self._west <= place.x <= self._east and self._south <= place.y <= self._north:
            self._nodes[node.id] = (place.lon, place.lat)
            self._node_tags[node.id] = dict(node.tags)

    def _add_way(self, way: OsmWay) -> None:
        if self._last_relation:
            raise self._out_of_order()
        points = [(node.ref, node.x, node.y) for node in way.nodes]
        refs, xs, ys = zip(*points, strict=True) if points else ((0,), (_NOWHERE,), (_NOWHERE,))
        if max(xs) > _MOST_X or max(ys) > _MOST_Y:  # nodes missing in the extract
            known = [(x, y) for x, y in zip(xs, ys, strict=True) if x <= _MOST_X and y <= _MOST_Y]
            xs, ys = zip(*known, strict=True) if known else ((_NOWHERE,), (_NOWHERE,))
        if min(refs) < 0:
            raise self._out_of_order()
        self._last_node = max(self._last_node, *refs)
        low_x, low_y, high_x, high_y = min(xs), min(ys), max(xs), max(ys)
        self._way_ids.append(way.id)
        self._refs.extend(refs if points else ())
        self._firsts.append(len(self._refs))
        self._bounds.extend((low_x, low_y, high_x, high_y))
        if self._meets(low_x, low_y, high_x, high_y):
            self._keep(Way(way.id, refs if points else (), dict(way.tags)))

    def _add_relation(self, relation: OsmRelation) -> None:
        self._last_relation = max(self._last_relation, relation.id, 1)
        kind = relation.tags.get("type")
        if kind not in (*_AREAS, _TURNS):
            return
        members = tuple((m.type, m.ref, m.role) for m in relation.members)
        ways = [ref for kind, ref, _ in members if kind == "w"]
        if kind == _TURNS:
            wanted = any(way in self._ways for way in ways)
        else:
            rows = self._rows(ways)
            bounds = np.frombuffer(self._bounds, np.intc).reshape(-1, 4)[rows]
            wanted = len(rows) > 0 and self._meets(
                *bounds[:, :2].min(axis=0).tolist(), *bounds[:, 2:].max(axis=0).tolist()
            )
            if wanted:
                self._keep_outlines(rows)
        if wanted:
            self._relations[relation.id] = Relation(relation.id, members, dict(relation.tags))

    def _keep_outlines(self, rows: NDArray[np.int64]) -> None:
        """Keep the ways of an area; distant ones without tags, since only the area uses them."""
        for row in rows.tolist():
            if self._way_ids[row] not in self._ways:
                refs = self._refs[self._firsts[row] : self._firsts[row + 1]]
                self._keep(Way(self._way_ids[row], tuple(refs), {}))

    def _keep(self, way: Way) -> None:
        self._ways[way.id] = way
        for ref in way.nodes:
            if ref not in self._nodes:
                try:
                    place = self._places.get(ref)
                except KeyError:  # missing in the extract
                    continue
                if place.valid():
                    self._nodes[ref] = (place.lon, place.lat)

    def _rows(self, ways: list[int]) -> NDArray[np.int64]:
        """Return the row numbers of the given ways that are in the map."""
        ids = np.frombuffer(self._way_ids, np.int64)
        if self._order is None:
            self._order = np.argsort(ids, kind="stable")
        if not len(ids):
            return np.empty(0, np.int64)
        at = np.searchsorted(ids, ways, sorter=self._order).clip(0, len(ids) - 1)
        rows = self._order[at]
        return np.asarray(rows[ids[rows] == np.array(ways, np.int64)], np.int64)

    def _meets(self, west: float, south: float, east: float, north: float) -> bool:
        return bool(
            west <= self._east
            and self._west <= east
            and south <= self._north
            and self._south <= north
        )

    def _out_of_order(self) -> InputError:
        return InputError(
            "is large and its nodes, ways and relations are not in this order, by ids above 0",
            file=self._path,
            expected=f"a sorted extract: osmium sort {self._path.name} -o map.osm.pbf",
        )
