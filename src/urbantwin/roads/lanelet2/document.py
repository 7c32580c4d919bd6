"""The file of a Lanelet2 map: nodes, ways and relations in OpenStreetMap's XML.

Source: Poggenhans et al., "Lanelet2: a high-definition map framework for the future of automated
driving", ITSC 2018, and the format's description, ``lanelet2_io/doc`` and
``lanelet2_core/doc/LaneletAndAreaTagging.md``.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

from lxml import etree

from urbantwin.errors import InputError
from urbantwin.number_text import finite_number, whole_number

__all__ = ["EXPECTED", "Document", "Node", "Relation", "Way", "is_lanelet2", "read_document"]

EXPECTED = "a Lanelet2 map: OSM XML with relations of type=lanelet"
#: Tag of a relation that is a lanelet.
_LANELET = re.compile(rb"""<tag\s+(?:k=['"]type['"]\s+v=['"]lanelet['"]|v=['"]lanelet['"]\s+k=)""")
_CHUNK = 1 << 20


@dataclass(frozen=True)
class Node:
    """A point: latitude and longitude in degrees (nan if missing) and its tags."""

    latitude: float
    longitude: float
    tags: dict[str, str]


@dataclass(frozen=True)
class Way:
    """A line string: ids of its nodes, and its tags."""

    nodes: tuple[int, ...]
    tags: dict[str, str]


@dataclass(frozen=True)
class Relation:
    """Members as (``node`` | ``way`` | ``relation``, id, role), and tags."""

    members: tuple[tuple[str, int, str], ...]
    tags: dict[str, str]

    def of_role(self, role: str, kind: str = "way") -> list[int]:
        """Return the ids of the members with a role."""
        return [ref for member, ref, name in self.members if member == kind and name == role]


@dataclass(frozen=True)
class Document:
    """A complete file with its own ids.

    Attributes:
        path: the file.
        nodes, ways, relations: its contents by id.
        dropped: errors of the dropped elements, in the order of reading.
    """

    path: Path
    nodes: dict[int, Node]
    ways: dict[int, Way]
    relations: dict[int, Relation]
    dropped: tuple[InputError, ...] = ()

    def error(self, problem: str, relation: int | None = None) -> InputError:
        """Return an error with the file, a relation, and its position."""
        place = None if relation is None else f"relation {relation}{self._where(relation)}"
        return InputError(problem, file=self.path, place=place, expected=EXPECTED)

    def _where(self, relation: int) -> str:
        """Return the position of a relation as text: its first point with degrees."""
        item = self.relations.get(relation, Relation((), {}))
        ways = (self.ways[ref] for _, ref, _ in item.members if ref in self.ways)
        for node in (self.nodes[n] for osm_way in ways for n in osm_way.nodes if n in self.nodes):
            if math.isfinite(node.latitude) and (node.latitude or node.longitude):
                return f" at {node.latitude:.5f}, {node.longitude:.5f}"
        return ""


def is_lanelet2(path: Path) -> bool:
    """Return whether a file contains a lanelet, by a search for the tag only.

    False for a missing file, a folder and a compressed extract.
    """
    try:
        with path.open("rb") as file:
            previous = b""
            while chunk := file.read(_CHUNK):
                text = previous + chunk
                if _LANELET.search(text):
                    return True
                previous = text[-256:]
    except OSError:
        return False
    return False


def read_document(path: Path) -> Document:
    """Read nodes, ways and relations that are not deleted.

    Those without a numeric id are dropped.

    Raises:
        InputError: the file is missing, is not XML or OSM, has a document type or entities, or has
            no lanelets.
    """
    root = _root(path)
    nodes: dict[int, Node] = {}
    ways: dict[int, Way] = {}
    relations: dict[int, Relation] = {}
    dropped: list[InputError] = []
    for item in root:
        if not isinstance(item.tag, str) or item.get("action") == "delete":
            continue
        if item.get("visible") == "false":
            continue
        try:
            if item.tag == "node":
                degrees = _degrees(item.get("lat"), 90.0), _degrees(item.get("lon"), 180.0)
                nodes[_id(path, item, "id")] = Node(*degrees, _tags(item))
            elif item.tag == "way":
                refs = tuple(_id(path, nd, "ref") for nd in item.iterfind("nd"))
                ways[_id(path, item, "id")] = Way(refs, _tags(item))
            elif item.tag == "relation":
                members = tuple(
                    (m.get("type", ""), _id(path, m, "ref"), m.get("role", ""))
                    for m in item.iterfind("member")
                )
                relations[_id(path, item, "id")] = Relation(members, _tags(item))
        except InputError as error:
            dropped.append(error)
    document = Document(path, nodes, ways, relations, tuple(dropped))
    if not any(r.tags.get("type") == "lanelet" for r in relations.values()):
        if dropped:
            raise dropped[0]
        streets = any("highway" in osm_way.tags for osm_way in ways.values())
        raise document.error(
            "is a street map of OpenStreetMap, without lanelets" if streets else "has no lanelets"
        )
    return document


def _root(path: Path) -> etree._Element:
    if not path.is_file():
        problem = "not found" if not path.exists() else "is a folder"
        raise InputError(problem, file=path, expected=EXPECTED)
    # Untrusted file: no downloads, no expansion of entities, limited depth.
    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, remove_comments=True
    )
    try:
        tree = etree.parse(str(path), parser)
    except (etree.XMLSyntaxError, OSError) as error:
        text = str(error).splitlines()[0] if str(error) else "it is empty"
        raise InputError(f"is not XML ({text})", file=path, expected=EXPECTED) from None
    if tree.docinfo.internalDTD is not None:
        raise InputError("declares a document type or entities", file=path, expected=EXPECTED)
    root = tree.getroot()
    if root.tag != "osm":
        raise InputError(f"is XML, but <{root.tag}>, not <osm>", file=path, expected=EXPECTED)
    return root


def _id(path: Path, item: etree._Element, key: str) -> int:
    text = item.get(key, "")
    value = whole_number(text)
    if value is None:
        owner = item if key == "id" else item.getparent()
        raise InputError(
            f"<{item.tag}> has {key}={text[:40]!r}",
            file=path,
            place=f"{owner.tag} {owner.get('id')}, line {item.sourceline}",
            expected="a whole number",
        )
    return value


def _tags(item: etree._Element) -> dict[str, str]:
    return {tag.get("k", ""): tag.get("v", "") for tag in item.iterfind("tag")}


def _degrees(text: str | None, most: float) -> float:
    value = finite_number(text)
    return math.nan if value is None or abs(value) > most else value
