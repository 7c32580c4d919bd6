"""Reading OpenDRIVE as a lane model."""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from lxml import etree

from urbantwin.errors import InputError
from urbantwin.number_text import whole_number
from urbantwin.roads.model import CURB_HEIGHT_M, LaneModel, ModelRoad
from urbantwin.roads.opendrive.reading.file import top_elements
from urbantwin.roads.opendrive.reading.header import Header, read_header
from urbantwin.roads.opendrive.reading.identifiers import with_model_ids
from urbantwin.roads.opendrive.reading.junctions import Node, read_node
from urbantwin.roads.opendrive.reading.lane_attributes import Street, speed_of
from urbantwin.roads.opendrive.reading.lane_sections import reach_of, read_sections
from urbantwin.roads.opendrive.reading.lateral_profile import read_heights
from urbantwin.roads.opendrive.reading.links import Link, joined, read_links
from urbantwin.roads.opendrive.reading.objects import Outline, read_outlines
from urbantwin.roads.opendrive.reading.parsing import Log, Spot, id_number
from urbantwin.roads.opendrive.reading.placement import shifted
from urbantwin.roads.opendrive.reading.plan_view import read_curve
from urbantwin.roads.opendrive.reading.signal_references import (
    Reference,
    read_references,
    resolve_references,
)
from urbantwin.roads.opendrive.reading.signals import Program, Sign, read_program, read_signs
from urbantwin.roads.opendrive.vocabulary import DRIVEN

__all__ = ["ReadMap", "read_opendrive"]

#: Type of road -> class of street in OpenStreetMap's words; all others are unknown.
CLASS_OF_TYPE = {
    "motorway": "motorway",
    "rural": "secondary",
    "town": "unclassified",
    "townExpressway": "trunk",
    "townArterial": "primary",
    "townCollector": "tertiary",
    "townLocal": "residential",
    "townPrivate": "service",
    "townPlayStreet": "living_street",
    "lowSpeed": "living_street",
    "pedestrian": "pedestrian",
    "bicycle": "cycleway",
}


class ReadMap(NamedTuple):
    """A map as it was read.

    Attributes:
        model: its lane model, in the map's own coordinates.
        projection: their CRS, as PROJ or WKT; ``None`` where the map does not say.
        notes: version, counts, and what was assumed and left out (``remarks``).
    """

    model: LaneModel
    projection: str | None
    notes: dict[str, object]


@dataclass
class _Content:
    """What a file holds, by its own ids."""

    header: Header = field(default_factory=Header)
    roads: dict[str, ModelRoad] = field(default_factory=dict)
    links: dict[str, dict[str, Link]] = field(default_factory=dict)
    inside: dict[str, str] = field(default_factory=dict)
    rules: Counter[str] = field(default_factory=Counter)
    nodes: dict[str, Node] = field(default_factory=dict)
    programs: dict[str, Program] = field(default_factory=dict)
    outlines: list[tuple[str, Outline]] = field(default_factory=list)
    signs: list[tuple[str, Sign]] = field(default_factory=list)
    references: list[tuple[str, Reference]] = field(default_factory=list)
    has_heights: bool = False
    gone: set[str] = field(default_factory=set)
    signals_gone: set[str] = field(default_factory=set)

    def drop_road(self, item: etree._Element) -> None:
        """Note the id of a road that is not used, and its signals'."""
        self.gone.add(item.get("id", ""))
        self.signals_gone |= {e.get("id", "") for e in item.iterfind("signals/signal")}


def read_opendrive(path: Path) -> ReadMap:
    """Read an OpenDRIVE file, version 1.1 to 1.8.

    Ids are the file's where they are whole numbers, else they are numbered. Coordinates are moved
    by the header's ``<offset>`` where the file has a georeference.

    The smallest element that holds a fault is dropped: a link, a lane, a signal, a road. In the
    notes, ``dropped`` lists each with its id and its place.

    Args:
        path: the ``.xodr``.

    Raises:
        InputError: the file cannot be read, is not OpenDRIVE, or holds faults and no road to drive
            on besides; the line says where.
    """
    log = Log(path)
    content = _Content()
    for item in top_elements(path):
        identity = item.get("id", "")
        spot = log.at(f"{item.tag} {identity}")
        if item.tag == "header":
            content.header = read_header(item, log)
        elif item.tag == "road":
            with spot.dropping():
                _once(identity, content.roads, spot)
                try:
                    _road(item, identity, content, spot)
                except InputError:
                    content.drop_road(item)
                    raise
        elif item.tag == "junction":
            with spot.dropping():
                _once(identity, content.nodes, spot)
                content.nodes[identity] = read_node(item)
        elif item.tag == "controller":
            with spot.dropping():
                _once(identity, content.programs, spot)
                content.programs[identity] = read_program(item, spot)
        else:
            log.at("").remark(f"<{item.tag}> that is not read")
    content.gone -= content.roads.keys()
    found = _assembled(content, log) if content.roads else None
    if log.dropped and (found is None or not _is_driven(found.model)):
        raise log.dropped[0]
    if found is None:
        raise log.at("").error("has no roads", expected="<road>")
    return found


def _is_driven(model: LaneModel) -> bool:
    """Return whether a model has a lane of some width that traffic drives on."""
    return any(
        lane.kind in DRIVEN and float(lane.width.at(np.linspace(0.0, end - section.s, 5)).max()) > 0
        for road in model.roads
        for section, end in zip(road.sections, road.section_ends, strict=True)
        for lane in section.lanes
    )


def _once(identity: str, known: Container[str], spot: Spot) -> None:
    if not identity:
        raise spot.error("has no id")
    if identity in known:
        raise spot.error("is there twice", expected="each id once")


def _road(item: etree._Element, identity: str, content: _Content, spot: Spot) -> None:
    rule = item.get("rule") or "RHT"
    if rule not in ("RHT", "LHT"):
        spot.drop(f"has the rule {rule[:20]!r}: RHT is taken")
        rule = "RHT"
    curve = read_curve(item, spot)
    street = Street(rule, tuple(_speeds(item, spot)))
    sections = read_sections(item, curve.length, street, spot)
    offset = spot.profile(item.findall("lanes/laneOffset"))
    reach = reach_of(sections, offset, curve.length)
    elevation, bank, crown = read_heights(item, curve.length, reach, spot)
    tilted = not (bank.is_zero and crown.is_zero)
    if tilted and item.find(".//lane[@level='true']") is not None:
        spot.remark("level lanes beside a tilted carriageway: they are tilted too")
    notes = {e.get("code"): e.get("value") or "" for e in item.findall("userData")}
    kinds = [e.get("type", "") for e in item.findall("type")]
    ways = notes.get("ways", "").split()
    level = id_number(notes.get("level", ""))
    road = ModelRoad(
        id=len(content.roads) + 1,
        name=item.get("name") or "",
        kind=notes.get("class") or CLASS_OF_TYPE.get(kinds[0] if kinds else "", ""),
        ways=tuple(way for way in map(whole_number, ways) if way is not None),
        junction=-1,
        curve=curve,
        offset=offset,
        elevation=elevation,
        bank=bank,
        crown=crown,
        sections=sections,
        level=int(item.find("objects/bridge") is not None) if level is None else level,
    )
    if item.find("railroad/switch") is not None:
        spot.remark("railway switches that are not read")
    # The road as a whole is valid here; invalid elements of it are dropped one by one.
    content.roads[identity] = road
    content.rules[rule] += 1
    content.links[identity] = read_links(item, spot)
    content.inside[identity] = item.get("junction") or "-1"
    content.outlines += [(identity, e) for e in read_outlines(item, curve, elevation, spot)]
    content.signs += [(identity, e) for e in read_signs(item, road, spot)]
    content.references += [(identity, e) for e in read_references(item, road, spot)]
    content.has_heights |= item.find(".//lane/height") is not None


def _speeds(item: etree._Element, spot: Spot) -> Iterator[tuple[float, float]]:
    for kind in item.findall("type"):
        for speed in kind.findall("speed"):
            with spot.dropping():
                limit = speed_of(speed, spot)
                if limit is not None:
                    yield spot.number(kind, "s", 0.0), limit


def _assembled(content: _Content, log: Log) -> ReadMap:
    left = content.rules["LHT"] > content.rules["RHT"]
    if len(content.rules) > 1:
        log.at("").remark(
            "roads of left-hand and of right-hand traffic: the more frequent is taken"
        )
    if not content.has_heights:
        content.roads = {key: _curbed(road, log) for key, road in content.roads.items()}
    whole = [id_number(key) for key in content.roads]
    if None not in whole and len(set(whole)) == len(whole):
        ids = dict(zip(content.roads, whole, strict=True))
        content.roads = {key: replace(e, id=ids[key] or 0) for key, e in content.roads.items()}
    else:
        log.at("").remark("ids of roads that are not whole numbers: roads are numbered")
    found = joined(
        content.roads, content.links, content.inside, content.nodes, log, gone=content.gone
    )
    kept = {road.id for road in found.roads}
    gone = {key for key, road in content.roads.items() if road.id not in kept}
    content.roads = {key: e for key, e in content.roads.items() if key not in gone}
    content.signals_gone |= {sign.id for key, sign in content.signs if key in gone}
    content.outlines = [row for row in content.outlines if row[0] not in gone]
    content.signs = [row for row in content.signs if row[0] not in gone]
    content.references = [row for row in content.references if row[0] not in gone]
    signs = resolve_references(content.roads, content.signs, content.references, log)
    areas, signals, controllers = with_model_ids(
        content.roads,
        content.outlines,
        signs,
        content.programs,
        found.programs,
        log,
        gone=content.signals_gone - {sign.id for _, sign in signs},
    )
    model = LaneModel(
        "left" if left else "right", found.roads, found.junctions, areas, signals, controllers
    )
    header = content.header
    if header.projection is not None:
        model = shifted(model, header.offset)
    elif any(header.offset):
        log.at("header").remark("an offset without a georeference: it is not applied")
    notes: dict[str, object] = {
        "version": header.version,
        "made_by": header.vendor,
        "map_roads": len(found.roads),
        "map_junctions": len(found.junctions),
        "map_signals": len(signals),
        "map_areas": len(areas),
        "remarks": log.lines(),
        "dropped": log.dropped_lines(),
    }
    return ReadMap(model, header.projection, notes)


def _curbed(road: ModelRoad, log: Log) -> ModelRoad:
    """Return a road of a file without heights, its sidewalks raised as they usually are."""
    kinds = ("sidewalk", "curb")
    if not any(lane.kind in kinds for section in road.sections for lane in section.lanes):
        return road
    log.at("").remark("sidewalks, but no heights of lanes: 0.15 m is assumed")
    sections = []
    for section in road.sections:
        lanes = tuple(
            replace(lane, height=CURB_HEIGHT_M if lane.kind in kinds else 0.0)
            for lane in section.lanes
        )
        sections.append(replace(section, lanes=lanes))
    return replace(road, sections=tuple(sections))
