"""OpenStreetMap extracts: features in the site frame, and cutting to the region."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import SiteFrame

__all__ = ["Extract", "OsmFeature", "Relation", "Way", "WayPiece"]

#: Keys that make a closed way an area (OSM wiki, "Area"); ``area=yes|no`` overrides them.
AREA_KEYS = {
    "building", "building:part", "landuse", "leisure", "amenity", "shop", "area:highway",
    "natural", "water", "place", "tourism", "man_made", "public_transport", "office", "boundary",
}  # fmt: skip
LINE_NATURAL = {"coastline", "tree_row", "cliff", "ridge", "valley"}


@dataclass(frozen=True)
class Way:
    """A way: its nodes' ids in order, and its tags."""

    id: int
    nodes: tuple[int, ...]
    tags: dict[str, str]


@dataclass(frozen=True)
class Relation:
    """A relation: members as (type "n"|"w"|"r", id, role), and its tags."""

    id: int
    members: tuple[tuple[str, int, str], ...]
    tags: dict[str, str]


@dataclass(frozen=True)
class OsmFeature:
    """A tagged element of the map; ``geometry`` in the site frame, metres, not clipped."""

    kind: str
    id: int
    tags: dict[str, str]
    geometry: shapely.Geometry


@dataclass(frozen=True, eq=False)
class WayPiece:
    """A way, or a part cut out of one.

    Attributes:
        id: id of the piece.
        way: id of its OSM way; 0 if it is not in the map.
        nodes: ids of its nodes.
        points: (N, 2) their positions, site frame, metres.
        tags: the way's tags.
    """

    id: int
    way: int
    nodes: tuple[int, ...]
    points: NDArray[np.float64]
    tags: dict[str, str]


@dataclass(frozen=True)
class Extract:
    """An extract in memory: whole, or the part of a large one near the region.

    Attributes:
        path: the file.
        nodes: id -> (longitude, latitude), degrees.
        node_tags: id -> tags, for nodes that have any.
        ways: id -> way.
        relations: id -> relation.
        bounds: declared west, south, east, north in degrees, if the file declares them.
        highest: highest ids of nodes, ways and relations in the file that were not read.
        is_whole: whether the whole file was read.
    """

    path: Path
    nodes: dict[int, tuple[float, float]]
    node_tags: dict[int, dict[str, str]]
    ways: dict[int, Way]
    relations: dict[int, Relation]
    bounds: tuple[float, float, float, float] | None
    highest: tuple[int, int, int] = (0, 0, 0)
    is_whole: bool = True

    def highways(self) -> list[Way]:
        """Return the ways that are roads or paths of any kind, in the order of their ids."""
        return [way for _, way in sorted(self.ways.items()) if "highway" in way.tags]

    def way_line(self, way: Way, frame: SiteFrame) -> NDArray[np.float64]:
        """Return a way's known nodes as points (N, 2), site frame."""
        return frame.site_from_lonlat([self.nodes[n] for n in way.nodes if n in self.nodes])

    def features(self, frame: SiteFrame, area: shapely.Polygon) -> list[OsmFeature]:
        """Return every tagged element that touches ``area`` (site frame), sorted by kind and id.

        Closed ways that describe areas and multipolygon relations become polygons. Relation members
        missing in the extract are omitted.
        """
        found: list[OsmFeature] = []
        ids = list(self.nodes)
        xy = frame.site_from_lonlat([self.nodes[n] for n in ids])
        position = dict(zip(ids, map(tuple, xy), strict=True))
        shapely.prepare(area)
        for identity, tags in sorted(self.node_tags.items()):
            point = shapely.Point(position[identity])
            if area.intersects(point):
                found.append(OsmFeature("node", identity, tags, point))
        for identity, way in sorted(self.ways.items()):
            points = [position[n] for n in way.nodes if n in position]
            if not way.tags or len(points) < 2:
                continue
            shape: shapely.Geometry = shapely.LineString(points)
            if _is_area(way) and len(points) >= 4 and points[0] == points[-1]:
                shape = _valid_area(shapely.Polygon(points))
            if not shape.is_empty and area.intersects(shape):
                found.append(OsmFeature("way", identity, way.tags, shape))
        for identity, relation in sorted(self.relations.items()):
            if relation.tags.get("type") not in ("multipolygon", "building"):
                continue
            shape = self._assemble(relation, position)
            if not shape.is_empty and area.intersects(shape):
                found.append(OsmFeature("relation", identity, relation.tags, shape))
        return found

    def _assemble(
        self, relation: Relation, position: dict[int, tuple[float, ...]]
    ) -> shapely.Geometry:
        rings: dict[str, list[shapely.LineString]] = {"outer": [], "inner": []}
        for kind, identity, role in relation.members:
            way = self.ways.get(identity) if kind == "w" else None
            role = {"": "outer", "outline": "outer"}.get(role, role)  # noqa: PLW2901
            if way is None or role not in rings:
                continue
            points = [position[n] for n in way.nodes if n in position]
            if len(points) >= 2:
                rings[role].append(shapely.LineString(points))
        outer = shapely.union_all(_polygons(rings["outer"]))
        inner = shapely.union_all(_polygons(rings["inner"]))
        return _valid_area(shapely.difference(outer, inner))

    def clipped(
        self, frame: SiteFrame, area: shapely.Polygon, ways: Iterable[Way]
    ) -> tuple[WayPiece, ...]:
        """Return ways, cut where they leave an area.

        A way that leaves and re-enters the area becomes several pieces, each with its own positive
        id; cuts get new nodes.

        Args:
            frame: the site frame.
            area: the area, site frame, metres.
            ways: ways to cut.
        """
        new_node = max(self.highest[0], max(self.nodes, default=0)) + 1
        new_way = max(self.highest[1], max(self.ways, default=0)) + 1
        pieces: list[WayPiece] = []
        for way in ways:
            known = [n for n in way.nodes if n in self.nodes]
            if len(known) < 2:
                continue
            xy = frame.site_from_lonlat([self.nodes[n] for n in known])
            for number, piece in enumerate(_cut(xy, area)):
                # A minus sign before an edge's id means its direction in SUMO, so pieces of ways
                # with negative ids (drawn in an editor, not uploaded) get new ids.
                own = number == 0 and way.id > 0
                identity = way.id if own else new_way
                new_way += not own
                ids = []
                for index, _ in piece:
                    if index is None:
                        ids.append(new_node)
                        new_node += 1
                    else:
                        ids.append(known[index])
                points = np.array([point for _, point in piece])
                pieces.append(WayPiece(identity, way.id, tuple(ids), points, way.tags))
        return tuple(pieces)

    def write_pieces(
        self,
        path: Path,
        frame: SiteFrame,
        pieces: Sequence[WayPiece],
        *,
        node_tags: Mapping[int, Mapping[str, str]] | None = None,
        no_turns: Iterable[tuple[int, int, int]] = (),
    ) -> None:
        """Write pieces of ways as OSM XML.

        Turn restrictions of the map are moved to the piece at their via node.

        Args:
            path: the file to write.
            frame: the site frame.
            pieces: pieces to write.
            node_tags: node -> tags that replace its own.
            no_turns: further forbidden turns: from one piece, over a node, to another piece.
        """
        root = ElementTree.Element("osm", version="0.6", generator="urbantwin")
        place = {
            node: (float(x), float(y))
            for piece in pieces
            for node, (x, y) in zip(piece.nodes, piece.points, strict=True)
        }
        lonlat = frame.lonlat_from_site(np.array(list(place.values())).reshape(-1, 2))
        for identity, cut in sorted(zip(place, lonlat.tolist(), strict=True)):
            lon, lat = self.nodes.get(identity, cut)
            element = ElementTree.SubElement(
                root, "node", id=str(identity), lat=f"{lat:.9f}", lon=f"{lon:.9f}", version="1"
            )
            own = self.node_tags.get(identity, {})
            _add_tags(element, (node_tags or {}).get(identity, own))
        for piece in pieces:
            element = ElementTree.SubElement(root, "way", id=str(piece.id), version="1")
            for node in piece.nodes:
                ElementTree.SubElement(element, "nd", ref=str(node))
            _add_tags(element, piece.tags)
        for identity, members, tags in self._restrictions(pieces):
            _add_restriction(root, identity, members, tags)
        first = max(self.highest[2], max(self.relations, default=0)) + 1
        for number, (start, via, end) in enumerate(no_turns):
            turn = [("way", start, "from"), ("node", via, "via"), ("way", end, "to")]
            tags = {"type": "restriction", "restriction": "no_u_turn"}
            _add_restriction(root, first + number, turn, tags)
        ElementTree.indent(root)
        ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)

    def _restrictions(
        self, pieces: Sequence[WayPiece]
    ) -> Iterator[tuple[int, list[tuple[str, int, str]], dict[str, str]]]:
        """Return id, members and tags of the map's turn restrictions that concern the pieces."""
        by_way: dict[int, list[WayPiece]] = {}
        for piece in pieces:
            by_way.setdefault(piece.way, []).append(piece)
        for identity, relation in sorted(self.relations.items()):
            if relation.tags.get("type") != "restriction":
                continue
            via = [ref for kind, ref, role in relation.members if kind == "n" and role == "via"]
            members = []
            for kind, ref, role in relation.members:
                if kind == "n" and role == "via":
                    members.append(("node", ref, role))
                elif kind == "w" and role in ("from", "to"):
                    members += [
                        ("way", piece.id, role)
                        for piece in by_way.get(ref, [])
                        if via[0:1] and via[0] in piece.nodes
                    ]
            roles = [role for _, _, role in members]
            if all(role in roles for role in ("from", "via", "to")):
                yield identity, members, relation.tags


def _is_area(way: Way) -> bool:
    if way.nodes[0] != way.nodes[-1] or way.tags.get("area") == "no":
        return False
    if way.tags.get("area") == "yes":
        return True
    if way.tags.get("natural") in LINE_NATURAL or "barrier" in way.tags or "highway" in way.tags:
        return False
    return any(key in way.tags for key in AREA_KEYS)


def _valid_area(shape: shapely.Geometry) -> shapely.Geometry:
    """Repair self-touching outlines, and keep polygons only."""
    if not shape.is_valid:
        shape = shapely.make_valid(shape)
    if shape.geom_type in ("Polygon", "MultiPolygon"):
        return shape
    return shapely.union_all(
        [p for p in shapely.get_parts(shape) if p.geom_type.endswith("Polygon")]
    )


def _polygons(lines: list[shapely.LineString]) -> list[shapely.Geometry]:
    if not lines:
        return []
    return [_valid_area(p) for p in shapely.get_parts(shapely.polygonize(lines))]


def _add_tags(element: ElementTree.Element, tags: Mapping[str, str]) -> None:
    for key, value in sorted(tags.items()):
        ElementTree.SubElement(element, "tag", k=key, v=value)


def _add_restriction(
    root: ElementTree.Element,
    identity: int,
    members: Iterable[tuple[str, int, str]],
    tags: Mapping[str, str],
) -> None:
    element = ElementTree.SubElement(root, "relation", id=str(identity), version="1")
    for kind, ref, role in members:
        ElementTree.SubElement(element, "member", type=kind, ref=str(ref), role=role)
    _add_tags(element, tags)


def _cut(
    xy: NDArray[np.float64], area: shapely.Polygon
) -> list[list[tuple[int | None, NDArray[np.float64]]]]:
    """Cut a polyline at an area's border; each piece is (index of the node or None, point)."""
    pieces: list[list[tuple[int | None, NDArray[np.float64]]]] = []
    current: list[tuple[int | None, NDArray[np.float64]]] = []
    for index in range(len(xy)):
        if index:
            segment = shapely.LineString(xy[index - 1 : index + 1])
            parts = [
                p
                for p in shapely.get_parts(shapely.intersection(segment, area))
                if p.geom_type == "LineString" and p.length > 1e-6
            ]
            start = xy[index - 1]
            for part in sorted(
                parts, key=lambda p: shapely.distance(shapely.Point(start), shapely.get_point(p, 0))
            ):
                ends = shapely.get_coordinates(part)
                if np.linalg.norm(ends[0] - start) > np.linalg.norm(ends[1] - start):
                    ends = ends[::-1]
                if np.linalg.norm(ends[0] - start) > 1e-6 or not current:
                    if len(current) > 1:
                        pieces.append(current)
                    at_node = np.linalg.norm(ends[0] - start) <= 1e-6
                    current = [(index - 1 if at_node else None, ends[0])]
                at_end = np.linalg.norm(ends[1] - xy[index]) <= 1e-6
                current.append((index if at_end else None, ends[1]))
                if not at_end:
                    pieces.append(current)
                    current = []
            if not parts:
                if len(current) > 1:
                    pieces.append(current)
                current = []
    if len(current) > 1:
        pieces.append(current)
    return pieces
