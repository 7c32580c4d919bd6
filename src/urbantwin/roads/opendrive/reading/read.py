"""Reading of OpenDRIVE as a lane model."""

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
from urbantwin.roads.model import CURB_HEIGHT_M, LaneModel, ModelRoad, Profile
from urbantwin.roads.opendrive.reading.junctions import Node, read_node
from urbantwin.roads.opendrive.reading.lane_sections import (
    Street,
    reach_of,
    read_sections,
    speed_of,
)
from urbantwin.roads.opendrive.reading.links import Link, joined, read_links
from urbantwin.roads.opendrive.reading.objects import WrittenArea, read_areas
from urbantwin.roads.opendrive.reading.parsing import (
    Header,
    Log,
    Spot,
    id_number,
    read_header,
    top_elements,
    user_data,
)
from urbantwin.roads.opendrive.reading.placement import shifted
from urbantwin.roads.opendrive.reading.plan_view import read_curve, read_heights
from urbantwin.roads.opendrive.reading.signals import (
    Program,
    Reference,
    WrittenSignal,
    read_program,
    read_references,
    read_signals,
    resolve_references,
    with_model_ids,
)
from urbantwin.roads.opendrive.vocabulary import DRIVEN

__all__ = ["ReadMap", "read_opendrive"]

#: Type of road -> class of street as in OpenStreetMap; all others are unknown.
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
    """A map as read.

    Attributes:
        model: its lane model, in the map's own coordinates.
        projection: their CRS, as PROJ or WKT; ``None`` if missing.
        notes: version, counts, assumptions and omissions (``remarks``).
    """

    model: LaneModel
    projection: str | None
    notes: dict[str, object]


@dataclass
class _Content:
    """The content of a file during reading, by ids in the file."""

    header: Header = field(default_factory=Header)
    roads: dict[str, ModelRoad] = field(default_factory=dict)
    links: dict[str, dict[str, Link]] = field(default_factory=dict)
    inside: dict[str, str] = field(default_factory=dict)
    rules: Counter[str] = field(default_factory=Counter)
    nodes: dict[str, Node] = field(default_factory=dict)
    programs: dict[str, Program] = field(default_factory=dict)
    areas: list[WrittenArea] = field(default_factory=list)
    signals: list[WrittenSignal] = field(default_factory=list)
    references: list[Reference] = field(default_factory=list)
    has_heights: bool = False
    dropped_roads: set[str] = field(default_factory=set)
    dropped_signals: set[str] = field(default_factory=set)

    def drop_road(self, item: etree._Element) -> None:
        """Record the ids of a dropped road and of its signals."""
        self.dropped_roads.add(item.get("id", ""))
        self.dropped_signals |= {e.get("id", "") for e in item.iterfind("signals/signal")}


def read_opendrive(path: Path) -> ReadMap:
    """Read an OpenDRIVE file, version 1.1 to 1.8.

    Ids are those of the file if they are whole numbers, else new numbers. If the file has a
    georeference, the header's ``<offset>`` is applied to coordinates.

    The smallest element with an error is dropped: a link, a lane, a signal, a road. The notes'
    ``dropped`` lists each with its id and its place.

    Args:
        path: the ``.xodr``.

    Raises:
        InputError: the file cannot be read, is not OpenDRIVE, or has errors and no other driven
            road; the message says where.
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
                _check_id(identity, content.roads, spot)
                try:
                    _road(item, identity, content, spot)
                except InputError:
                    content.drop_road(item)
                    raise
        elif item.tag == "junction":
            with spot.dropping():
                _check_id(identity, content.nodes, spot)
                content.nodes[identity] = read_node(item)
        elif item.tag == "controller":
            with spot.dropping():
                _check_id(identity, content.programs, spot)
                content.programs[identity] = read_program(item, spot)
        else:
            log.at("").remark(f"<{item.tag}> that is not read")
    content.dropped_roads -= content.roads.keys()
    result = _assembled(content, log) if content.roads else None
    if log.dropped and (result is None or not _is_driven(result.model)):
        raise log.dropped[0]
    if result is None:
        raise log.at("").error("has no roads", expected="<road>")
    return result


def _is_driven(model: LaneModel) -> bool:
    """Return whether a model has a driven lane with some width."""
    return any(
        lane.kind in DRIVEN and float(lane.width.at(np.linspace(0.0, end - section.s, 5)).max()) > 0
        for road in model.roads
        for section, end in zip(road.sections, road.section_ends, strict=True)
        for lane in section.lanes
    )


def _check_id(identity: str, known: Container[str], spot: Spot) -> None:
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
    notes = user_data(item)
    kind = item.find("type")
    level = id_number(notes.get("level", ""))
    flat = ModelRoad(
        id=len(content.roads) + 1,
        name=item.get("name") or "",
        kind=notes.get("class")
        or CLASS_OF_TYPE.get("" if kind is None else kind.get("type", ""), ""),
        ways=tuple(
            ref for ref in map(whole_number, notes.get("ways", "").split()) if ref is not None
        ),
        junction=-1,
        curve=curve,
        offset=spot.profile(item.findall("lanes/laneOffset")),
        elevation=Profile.constant(0.0),
        bank=Profile.constant(0.0),
        crown=Profile.constant(0.0),
        sections=sections,
        level=int(item.find("objects/bridge") is not None) if level is None else level,
    )
    elevation, bank, crown = read_heights(item, curve.length, reach_of(flat), spot)
    road = replace(flat, elevation=elevation, bank=bank, crown=crown)
    if not (bank.is_zero and crown.is_zero) and item.find(".//lane[@level='true']") is not None:
        spot.remark("level lanes beside a tilted carriageway: they are tilted too")
    if item.find("railroad/switch") is not None:
        spot.remark("railway switches that are not read")
    # The road as a whole is valid here; invalid elements of it are dropped individually.
    content.roads[identity] = road
    content.rules[rule] += 1
    content.links[identity] = read_links(item, spot)
    content.inside[identity] = item.get("junction") or "-1"
    content.areas += read_areas(item, identity, curve, elevation, spot)
    content.signals += read_signals(item, identity, road, spot)
    content.references += read_references(item, identity, road, spot)
    content.has_heights |= item.find(".//lane/height") is not None


def _speeds(item: etree._Element, spot: Spot) -> Iterator[tuple[float, float]]:
    for kind in item.findall("type"):
        for speed in kind.findall("speed"):
            with spot.dropping():
                limit = speed_of(speed, spot)
                if limit is not None:
                    yield spot.number(kind, "s", 0.0), limit


def _assembled(content: _Content, log: Log) -> ReadMap:
    is_left_hand = content.rules["LHT"] > content.rules["RHT"]
    if len(content.rules) > 1:
        log.at("").remark(
            "roads of left-hand and of right-hand traffic: the more frequent is taken"
        )
    if not content.has_heights:
        content.roads = {key: _curbed(road, log) for key, road in content.roads.items()}
    road_ids = [id_number(key) for key in content.roads]
    if None not in road_ids and len(set(road_ids)) == len(road_ids):
        ids = dict(zip(content.roads, road_ids, strict=True))
        content.roads = {key: replace(e, id=ids[key] or 0) for key, e in content.roads.items()}
    else:
        log.at("").remark("ids of roads that are not whole numbers: roads are numbered")
    network = joined(
        content.roads,
        content.links,
        content.inside,
        content.nodes,
        log,
        dropped=content.dropped_roads,
    )
    used = {road.id for road in network.roads}
    roads = {key: road for key, road in content.roads.items() if road.id in used}
    signals = resolve_references(
        roads,
        [signal for signal in content.signals if signal.road in roads],
        [reference for reference in content.references if reference.road in roads],
        log,
    )
    dropped = content.dropped_signals | {s.id for s in content.signals if s.road not in roads}
    areas, heads, controllers = with_model_ids(
        roads,
        [area for area in content.areas if area.road in roads],
        signals,
        content.programs,
        network.programs,
        log,
        dropped=dropped - {signal.id for signal in signals},
    )
    model = LaneModel(
        "left" if is_left_hand else "right",
        network.roads,
        network.junctions,
        areas,
        heads,
        controllers,
    )
    header = content.header
    if header.projection is not None:
        model = shifted(model, header.offset)
    elif any(header.offset):
        log.at("header").remark("an offset without a georeference: it is not applied")
    notes: dict[str, object] = {
        "version": header.version,
        "made_by": header.vendor,
        "map_roads": len(network.roads),
        "map_junctions": len(network.junctions),
        "map_signals": len(heads),
        "map_areas": len(areas),
        "remarks": log.lines(),
        "dropped": log.dropped_lines(),
    }
    return ReadMap(model, header.projection, notes)


def _curbed(road: ModelRoad, log: Log) -> ModelRoad:
    """Return a road with sidewalks raised by the default height, for a file without heights."""
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
