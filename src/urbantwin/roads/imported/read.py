"""Reading of an imported map, in any of the formats, into the site frame."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from mmap import ACCESS_READ, mmap
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.roads import argoverse, lanelet2
from urbantwin.roads.imported.crop import part_of_road
from urbantwin.roads.model import (
    Connection,
    LaneModel,
    LaneSection,
    ModelJunction,
    ModelRoad,
    RoadLink,
    RoadSignal,
)
from urbantwin.roads.opendrive.reading.placement import placed, shifted
from urbantwin.roads.opendrive.reading.read import ReadMap, read_opendrive

__all__ = [
    "ImportedMap",
    "anchor_of",
    "describe_map",
    "is_map_of_roads",
    "is_placed",
    "map_format",
    "naming_file",
    "placed_map",
    "read_map",
]

#: Formats by file name extension.
FORMATS = {".xodr": "OpenDRIVE", ".osm": "Lanelet2", ".json": "Argoverse 2"}
_LANELET = re.compile(rb"""v=["']lanelet["']""")
EXPECTED = "an OpenDRIVE map (.xodr), a Lanelet2 map (.osm) or one of Argoverse 2 (.json)"
#: Length of a street between two directly linked junctions, metres, and its maximum share of a
#: connecting road.
STREET_M, SHARE = 2.0, 0.25
#: Maximum distance between the ends of connecting roads at one place, metres.
MEET_M = 1.0
#: A road and one of its ends (``start`` or ``end``).
_End = tuple[int, str]


@dataclass(frozen=True)
class ImportedMap:
    """A map in the site frame.

    Attributes:
        path: the file.
        model: the lane model.
        notes: findings and assumptions of the reader.
        heights_at_corners: whether the map has heights only at the corners of its lines, which may
            be as far apart as a straight street is long.
        drivable: mapped drivable area in plan, with or without lanes; empty if unknown.
    """

    path: Path
    model: LaneModel
    notes: dict[str, object] = field(default_factory=dict)
    heights_at_corners: bool = False
    drivable: shapely.Geometry = field(default_factory=shapely.MultiPolygon)


@dataclass(frozen=True)
class _DirectLink:
    """A place where connecting roads of two junctions are linked directly.

    Attributes:
        ends: junction -> ends of its roads there.
        host: the end of the road whose last metres become a street.
    """

    ends: Mapping[int, tuple[_End, ...]]
    host: _End


def map_format(path: Path) -> str:
    """Return ``OpenDRIVE``, ``Lanelet2`` or ``Argoverse 2`` by a file's extension.

    Raises:
        InputError: the extension is unknown.
    """
    format_name = FORMATS.get(path.suffix.lower())
    if format_name is None:
        raise InputError("has an unknown ending", file=path, expected=EXPECTED)
    return format_name


def is_map_of_roads(path: Path) -> bool:
    """Return whether a file is a supported road map, not an OpenStreetMap extract.

    Both kinds of ``.osm`` are the same XML; only Lanelet2 has relations of the type ``lanelet``.
    """
    if path.suffix.lower() == ".json":
        return argoverse.is_argoverse(path)
    if path.suffix.lower() != ".osm":
        return path.suffix.lower() in FORMATS
    try:
        with path.open("rb") as file, mmap(file.fileno(), 0, access=ACCESS_READ) as text:
            return bool(_LANELET.search(text))
    except (OSError, ValueError):  # an empty file cannot be mapped
        return False


def read_map(
    path: Path, frame: SiteFrame, anchor_m: tuple[float, float] | None = None
) -> ImportedMap:
    """Read a map into the site frame.

    Args:
        path: the file.
        frame: the site frame.
        anchor_m: for a map without georeference: its x, y of the anchor, metres, x east and y
            north. By default the map's origin is the anchor.

    Raises:
        InputError: the file cannot be read, or ``anchor_m`` is given for a georeferenced map.
    """
    kind = map_format(path)
    if kind == "OpenDRIVE":
        return placed_map(path, read_opendrive(path), frame, anchor_m)
    is_lanelet2 = kind == "Lanelet2"
    reader = lanelet2.read_lanelet2 if is_lanelet2 else argoverse.read_argoverse
    model, reader_notes = reader(path, frame)
    drivable = shapely.MultiPolygon() if is_lanelet2 else argoverse.drivable_area(path, frame)
    if anchor_m is not None:
        if is_placed(path):
            raise _placed_twice(path)
        model = shifted(model, (-anchor_m[0], -anchor_m[1], 0.0, 0.0))
        drivable = shapely.transform(drivable, lambda xy: xy - anchor_m)
    return ImportedMap(path, model, {"format": kind, **reader_notes}, not is_lanelet2, drivable)


def placed_map(
    path: Path, read: ReadMap, frame: SiteFrame, anchor_m: tuple[float, float] | None = None
) -> ImportedMap:
    """Return an OpenDRIVE map in the site frame; see ``read_map``."""
    notes: dict[str, object] = {"format": "OpenDRIVE", **read.notes}
    model, between, unfollowed = with_streets_between(read.model)
    if between:
        notes["junctions_joined_directly"] = between
    notes["dropped"] = [*read.notes["dropped"], *unfollowed]  # type: ignore[misc]
    if read.projection is not None:
        if anchor_m is not None:
            raise _placed_twice(path)
        with naming_file(path):
            return ImportedMap(path, placed(model, read.projection, frame), notes)
    x, y = anchor_m or (0.0, 0.0)
    notes["georeference"] = f"none in the map: x east, y north, and {x:g}, {y:g} is the anchor"
    return ImportedMap(path, shifted(model, (-x, -y, 0.0, 0.0)), notes)


@contextmanager
def naming_file(path: Path) -> Iterator[None]:
    """Add the file's name to errors without one."""
    try:
        yield
    except InputError as error:
        if error.file:
            raise
        raise InputError(
            error.problem, file=path, place=error.place, expected=error.expected
        ) from None


def anchor_of(path: Path) -> tuple[float, float]:
    """Return latitude and longitude of the centre of a Lanelet2 or Argoverse 2 map, degrees.

    Raises:
        InputError: it cannot be read or is not georeferenced.
    """
    if map_format(path) == "Argoverse 2":
        return argoverse.anchor_of(path)
    return lanelet2.anchor_of(path)


def is_placed(path: Path) -> bool:
    """Return whether a Lanelet2 or Argoverse 2 map is georeferenced."""
    if map_format(path) == "Argoverse 2":
        return argoverse.is_placed(path)
    try:
        anchor_of(path)
    except InputError:
        return False
    return True


def _placed_twice(path: Path) -> InputError:
    return InputError(
        "says itself where on earth it is",
        file=path,
        place="roads.anchor_m",
        expected="it only for a map without a georeference",
    )


def with_streets_between(model: LaneModel) -> tuple[LaneModel, list[str], list[str]]:
    """Return a model with a street between each two junctions that are linked directly.

    Args:
        model: the lane model of a map.

    Returns:
        The model, one line per new street, and one per ignored link of a connecting road.
    """
    notes, unfollowed = [], []
    for place in _places(model):
        model, street = _with_street(model, place)
        first, second = sorted(place.ends)
        notes.append(
            f"road {place.host[0]}: leads from junction {first} directly into junction {second}: "
            f"its last {street.length:.1f} m are street {street.id}"
        )
    for road in model.roads:
        for link in (road.predecessor, road.successor):
            if road.junction < 0 or link is None:
                continue
            target = link.id
            if link.element == "road":
                target = model.road_by_id[link.id].junction
                if target in (-1, road.junction):
                    continue
            unfollowed.append(
                f"road {road.id}: leads through junction {road.junction} into junction {target} "
                "where others join them: its link is not followed"
            )
    return model, notes, unfollowed


def _places(model: LaneModel) -> list[_DirectLink]:
    """Return the places where connecting roads of exactly two junctions are linked."""
    roads = model.road_by_id
    ends: dict[_End, RoadLink] = {}
    for road in model.roads:
        for end, link in (("start", road.predecessor), ("end", road.successor)):
            if road.junction < 0 or link is None:
                continue
            other = link.id if link.element == "junction" else roads[link.id].junction
            if other not in (-1, road.junction):
                ends[road.id, end] = link
    points = {end: _point(roads[end[0]], end[1]) for end in ends}
    clusters: list[list[_End]] = []
    for end_key in sorted(ends):
        close = [c for c in clusters if np.linalg.norm(points[c[0]] - points[end_key]) < MEET_M]
        if close:
            close[0].append(end_key)
        else:
            clusters.append([end_key])
    places = []
    for cluster in clusters:
        ends_of: dict[int, list[_End]] = defaultdict(list)
        for identity, end in cluster:
            ends_of[roads[identity].junction].append((identity, end))
        if len(ends_of) != 2:
            continue
        host = max(cluster, key=lambda item: (_driven(roads[item[0]], item[1]), -item[0]))
        places.append(_DirectLink({key: tuple(value) for key, value in ends_of.items()}, host))
    return places


def _with_street(model: LaneModel, place: _DirectLink) -> tuple[LaneModel, ModelRoad]:
    roads = dict(model.road_by_id)
    number, end = place.host
    host = roads[number]
    (other,) = set(place.ends) - {host.junction}
    length = min(STREET_M, SHARE * min(roads[e].length for e, _ in place.ends[host.junction]))
    at_start = end == "start"
    first, last = (0.0, length) if at_start else (host.length - length, host.length)
    street = part_of_road(host, first, last, model.next_id)
    links = (RoadLink("junction", host.junction), RoadLink("junction", other))
    street = replace(
        street,
        junction=-1,
        predecessor=links[at_start],
        successor=links[not at_start],
        sections=tuple(_unlinked(section, street) for section in street.sections),
    )
    roads[street.id] = street
    moved: dict[int, float] = {}
    connections: dict[int, list[Connection]] = {key: [] for key in place.ends}
    for junction, ends in place.ends.items():
        # The street's end at this junction.
        street_end = ("end" if at_start else "start") if junction == host.junction else end
        for identity, contact in ends:
            road = roads[identity]
            if junction == host.junction:
                cut = (length, road.length) if contact == "start" else (0.0, road.length - length)
                moved[identity] = -length if contact == "start" else 0.0
                road = part_of_road(road, *cut, identity)
            pairs = _pairs(road, contact, street, street_end)
            road = _linked(road, contact, RoadLink("road", street.id, street_end), pairs)
            roads[identity] = road
            inwards = [
                (pairs[lane.id], lane.id)
                for lane in _section(road, contact).lanes
                if lane.id in pairs and lane.forward == (contact == "start")
            ]
            if inwards:
                connections[junction].append(
                    Connection(street.id, identity, contact, tuple(inwards))
                )
    through_roads = {identity for ends in place.ends.values() for identity, _ in ends}
    junctions = tuple(
        _with_connections(junction, connections.get(junction.id, []), through_roads)
        for junction in model.junctions
    )
    order = [road.id for road in model.roads]
    return (
        replace(
            model,
            roads=tuple(roads[identity] for identity in (*order, street.id)),
            junctions=junctions,
            signals=tuple(_moved(e, moved, roads) for e in model.signals),
            areas=tuple(
                replace(e, s=float(np.clip(e.s + moved[e.road], 0.0, roads[e.road].length)))
                if e.road in moved
                else e
                for e in model.areas
            ),
        ),
        street,
    )


def _with_connections(
    junction: ModelJunction, made: Iterable[Connection], there: set[int]
) -> ModelJunction:
    """Return a junction with new connections that replace those from other connecting roads."""
    remaining = [e for e in junction.connections if e.incoming not in there]
    return replace(junction, connections=(*remaining, *made))


def _moved(
    signal: RoadSignal, moved: Mapping[int, float], roads: Mapping[int, ModelRoad]
) -> RoadSignal:
    if signal.road not in moved:
        return signal
    s = float(np.clip(signal.s + moved[signal.road], 0.0, roads[signal.road].length))
    return replace(signal, s=s)


def _unlinked(section: LaneSection, street: ModelRoad) -> LaneSection:
    """Return a section of a street whose lanes have links within the street only."""
    first, last = section is street.sections[0], section is street.sections[-1]
    lanes = tuple(
        replace(
            lane,
            predecessor=None if first else lane.predecessor,
            successor=None if last else lane.successor,
        )
        for lane in section.lanes
    )
    return replace(section, lanes=lanes)


def _linked(road: ModelRoad, contact: str, link: RoadLink, pairs: Mapping[int, int]) -> ModelRoad:
    """Return a road whose end, with its lanes, is linked to a street."""
    sections = list(road.sections)
    k = 0 if contact == "start" else -1
    lanes = tuple(
        replace(lane, predecessor=pairs.get(lane.id))
        if contact == "start"
        else replace(lane, successor=pairs.get(lane.id))
        for lane in sections[k].lanes
    )
    sections[k] = replace(sections[k], lanes=lanes)
    if contact == "start":
        return replace(road, predecessor=link, sections=tuple(sections))
    return replace(road, successor=link, sections=tuple(sections))


def _pairs(road: ModelRoad, contact: str, street: ModelRoad, near: str) -> dict[int, int]:
    """Return lane of a road -> adjacent lane of a street: the nearest of its direction and kind."""
    street_places = _middles(street, near)
    lane_of = {}
    for lane, place in _middles(road, contact).items():
        model_lane = _section(road, contact).by_id[lane]
        outwards = model_lane.forward == (contact == "end")
        gaps = [
            (float(np.linalg.norm(place - target)), other)
            for other, target in street_places.items()
            if (kind := _section(street, near).by_id[other]).forward
            == (outwards == (near == "start"))
            and kind.kind == model_lane.kind
        ]
        if gaps and min(gaps)[0] < MEET_M:
            lane_of[lane] = min(gaps)[1]
    return lane_of


def _middles(road: ModelRoad, end: str) -> dict[int, NDArray[np.float64]]:
    section = _section(road, end)
    s = 0.0 if end == "start" else road.length
    return {lane.id: road.place(s, road.middle(section, lane, s))[0, :2] for lane in section.lanes}


def _section(road: ModelRoad, end: str) -> LaneSection:
    return road.sections[0 if end == "start" else -1]


def _point(road: ModelRoad, end: str) -> NDArray[np.float64]:
    """Return the end of a road's reference line in plan (2,)."""
    x, y, _ = road.curve.at([0.0 if end == "start" else road.length])[0]
    return np.array([x, y])


def _driven(road: ModelRoad, end: str) -> int:
    return sum(lane.kind in ("driving", "bus", "bicycle") for lane in _section(road, end).lanes)


def describe_map(path: Path) -> dict[str, object]:
    """Return a map's format, georeference, size and counts, with its reader's remarks.

    Raises:
        InputError: it cannot be read.
    """
    if map_format(path) != "OpenDRIVE":
        place = anchor_of(path) if is_placed(path) else None
        imported = read_map(path, SiteFrame(*(place or (0.0, 0.0))))
        model, notes = imported.model, dict(imported.notes)
        place_text = (
            "none" if place is None else f"latitude {place[0]:.6f}, longitude {place[1]:.6f}"
        )
    else:
        read = read_opendrive(path)
        # Counts do not depend on the position.
        imported = placed_map(path, read._replace(projection=None), SiteFrame(0.0, 0.0))
        model, notes = read.model, dict(imported.notes)
        place_text = read.projection or "none"
    return {**notes, "georeference": place_text, **_counted(model)}


def _counted(model: LaneModel) -> dict[str, object]:
    streets = [road for road in model.roads if road.junction < 0]
    metres: Counter[str] = Counter()
    for road in model.roads:
        for section, end in zip(road.sections, road.section_ends, strict=True):
            for lane in section.lanes:
                metres[lane.kind] += round(end - section.s)
    points = np.vstack([road.curve.at([0.0, road.length])[:, :2] for road in model.roads])
    heights = np.concatenate([road.elevation.at([0.0, road.length]) for road in model.roads])
    return {
        "driving_side": model.driving_side,
        "streets": len(streets),
        "junctions": len(model.junctions),
        "signals": sum(signal.dynamic for signal in model.signals),
        "signs": sum(not signal.dynamic for signal in model.signals),
        "crosswalks": sum(area.kind == "crosswalk" for area in model.areas),
        "metres_of_lanes": dict(metres.most_common()),
        "size_m": [round(float(value), 1) for value in np.ptp(points, axis=0)],
        "lowest_m": round(float(heights.min()), 2),
        "highest_m": round(float(heights.max()), 2),
    }
