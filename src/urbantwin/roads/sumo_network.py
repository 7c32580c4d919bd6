"""Reading of a SUMO network as a lane network."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence, Set
from dataclasses import replace
from pathlib import Path

import numpy as np
from lxml import etree
from numpy.typing import NDArray

from urbantwin.geometry import moved_left
from urbantwin.roads.cross_section import SignedTurns
from urbantwin.roads.network import Junction, Lane, Road, RoadNetwork, SignalHead, SignalProgram

__all__ = ["edges_of_pieces", "read_sumo_network"]

#: Vehicle classes of SUMO by class of actors.
VEHICLE_CLASSES = {
    "car": "passenger",
    "truck": "truck",
    "bus": "bus",
    "motorcycle": "motorcycle",
    "bicycle": "bicycle",
    "pedestrian": "pedestrian",
}
MINIMAL_LENGTH = 1e-3  # metres; a line needs two distinct points
DEFAULT_WIDTH = 3.2  # SUMO's own, for lanes without a width


def read_sumo_network(
    path: Path,
    *,
    driving_side: str,
    level_of_way: dict[int, int],
    origin: dict[int, int],
    arrows: SignedTurns | None = None,
    one_lane: Set[int] = frozenset(),
) -> RoadNetwork:
    """Read a ``.net.xml`` with zero heights.

    Args:
        path: the network, coordinates in the site frame.
        driving_side: ``right`` or ``left``.
        level_of_way: way -> level, for ways that cross over others.
        origin: id of a cut piece -> id of its OSM way.
        arrows: signed turns of lanes.
        one_lane: ids of pieces on which both directions share a lane: netconvert has half of it for
            each direction.
    """
    root = etree.parse(path).getroot()
    levels = {
        edge.get("id"): _edge_level(edge, level_of_way, origin)
        for edge in root.findall("edge")
        if edge.get("function") is None
    }
    junction_level = _junction_levels(root, levels)
    successors, heads = _connections(root)
    parts = {_last_part(edge) for edge in root.findall("edge")}
    turns = {} if arrows is None else arrows.on(parts)
    lanes, roads = [], []
    for edge in root.findall("edge"):
        function = edge.get("function")
        inside = edge.get("id")[1:].rsplit("_", 1)[0] if function else ""
        level = junction_level.get(inside, 0) if function else levels[edge.get("id")]
        rows = [_lane(item, edge, function, level, inside) for item in edge.findall("lane")]
        signed = turns.get(_last_part(edge), ())
        for index, row in enumerate(rows):
            row["successors"] = tuple(successors.get(str(row["id"]), ()))
            if len(signed) == len(rows):
                row["arrows"] = signed[index]
        lanes += [Lane(**row) for row in rows]  # type: ignore[arg-type]
        if not function:
            roads.append(
                Road(
                    id=edge.get("id"),
                    name=edge.get("name", ""),
                    ways=_osm_way_ids(edge, origin),
                    kind=edge.get("type", "").split("|")[-1].removeprefix("highway."),
                    lanes=tuple(str(row["id"]) for row in rows),
                    from_junction=edge.get("from"),
                    to_junction=edge.get("to"),
                )
            )
    junctions = tuple(
        Junction(
            item.get("id"), item.get("type"), _shape(item), junction_level.get(item.get("id"), 0)
        )
        for item in root.findall("junction")
        if item.get("type") != "internal"
    )
    programs = tuple(
        SignalProgram(
            item.get("id"),
            float(item.get("offset", 0)),
            tuple((float(p.get("duration")), str(p.get("state"))) for p in item.findall("phase")),
        )
        for item in root.findall("tlLogic")
    )
    shared = _edges_of_pieces(root, one_lane)
    by_id = {lane.id: lane for lane in lanes}
    by_id |= _shared_lanes(by_id, [road for road in roads if road.id in shared], driving_side)
    lanes = list(by_id.values())
    signals = tuple(
        _head(program, by_id[lane], links)
        for (program, lane), links in sorted(heads.items())
        if lane in by_id
    )
    return RoadNetwork(driving_side, tuple(roads), tuple(lanes), junctions, signals, programs)


def _shared_lanes(
    lanes: Mapping[str, Lane], edges: Sequence[Road], driving_side: str
) -> dict[str, Lane]:
    """Return the lanes shared by opposite edges, combined from their innermost lanes.

    Args:
        lanes: all lanes by id.
        edges: edges of streets with one lane for both directions.
        driving_side: ``right`` or ``left``.
    """
    shared: dict[str, Lane] = {}
    edge_of = {(edge.id, edge.from_junction, edge.to_junction): edge for edge in edges}
    inward = 1 if driving_side == "right" else -1
    for edge in edges:
        turned = edge.id[1:] if edge.id.startswith("-") else f"-{edge.id}"
        other = edge_of.get((turned, edge.to_junction, edge.from_junction))
        if other is None:
            continue
        lane, half = (lanes[road.lanes[-1]] for road in (edge, other))
        centre = lane.centre.copy()
        centre[:, :2] = moved_left(centre[:, :2], inward * half.width / 2)
        width = lane.width + half.width
        shared[lane.id] = replace(lane, centre=centre, width=width, opposite=half.id)
    return shared


def edges_of_pieces(net: Path, pieces: Set[int]) -> frozenset[str]:
    """Return the ids of the edges that are made only of given pieces of ways."""
    return _edges_of_pieces(etree.parse(net).getroot(), pieces)


def _edges_of_pieces(root: etree._Element, pieces: Set[int]) -> frozenset[str]:
    ways_of = ((str(edge.get("id")), _osm_way_ids(edge, {})) for edge in root.iterfind("edge"))
    return frozenset(name for name, ids in ways_of if ids and set(ids) <= pieces)


def _shape(item: etree._Element) -> NDArray[np.float64]:
    text = item.get("shape") or ""
    return np.array([[float(v) for v in p.split(",")[:2]] for p in text.split()]).reshape(-1, 2)


def _osm_way_ids(edge: etree._Element, origin: dict[int, int]) -> tuple[int, ...]:
    way_ids: set[int] = set()
    for item in edge.iter("param"):
        if item.get("key") == "origId":
            for word in item.get("value").split():
                if word.lstrip("-").isdigit():
                    piece = abs(int(word))
                    way_ids.add(origin.get(piece, piece))
    way_ids.discard(0)  # pieces that are not in the map
    return tuple(sorted(way_ids))


def _last_part(edge: etree._Element) -> str:
    """Return the last of the edges that netconvert joined under the first one's name."""
    words = [
        item.get("value").split() for item in edge.iter("param") if item.get("key") == "origId"
    ]
    name = str(edge.get("id"))
    if not words or len(words[0]) < 2:
        return name
    return f"-{words[0][-1].lstrip('-')}" if name.startswith("-") else words[0][-1]


def _edge_level(edge: etree._Element, level_of_way: dict[int, int], origin: dict[int, int]) -> int:
    return min((level_of_way.get(way_id, 0) for way_id in _osm_way_ids(edge, origin)), default=0)


def _junction_levels(root: etree._Element, levels: dict[str, int]) -> dict[str, int]:
    """Return the level of each junction: that of its lowest road."""
    lowest: dict[str, int] = {}
    for edge in root.findall("edge"):
        if edge.get("function") is None:
            for end in (edge.get("from"), edge.get("to")):
                level = levels[edge.get("id")]
                lowest[end] = min(lowest.get(end, level), level)
    return lowest


def _connections(
    root: etree._Element,
) -> tuple[dict[str, list[str]], dict[tuple[str, str], list[int]]]:
    successors: dict[str, list[str]] = defaultdict(list)
    heads: dict[tuple[str, str], list[int]] = defaultdict(list)
    for item in root.findall("connection"):
        start = f"{item.get('from')}_{item.get('fromLane')}"
        end = f"{item.get('to')}_{item.get('toLane')}"
        via = item.get("via") or end
        if via not in successors[start]:
            successors[start].append(via)
        if item.get("tl"):
            # A pedestrian link applies to the crossing, not to the walking area that it starts
            # from.
            governed = end if start.startswith(":") else start
            heads[item.get("tl"), governed].append(int(item.get("linkIndex")))
    return successors, heads


def _lane(
    item: etree._Element, edge: etree._Element, function: str | None, level: int, inside: str
) -> dict[str, object]:
    shape = _shape(item)
    allowed = _allowed(item)
    outline = np.zeros((0, 2))
    if function == "walkingarea":
        outline = shape
    if np.ptp(shape, axis=0).max() < MINIMAL_LENGTH:
        # A connection across a mere transition between two roads has no length.
        shape = np.vstack([shape[:1], shape[:1] + [MINIMAL_LENGTH, 0.0]])
    return {
        "id": item.get("id"),
        "road": "" if function else edge.get("id"),
        "kind": _kind(function, allowed),
        "width": float(item.get("width", DEFAULT_WIDTH)),
        "speed_limit": float(item.get("speed")),
        "centre": np.column_stack([shape, np.zeros(len(shape))]),
        "outline": outline,
        "level": level,
        "allowed": allowed,
        "junction": inside,
        "marking": _marking(item),
    }


def _marking(item: etree._Element) -> str:
    """Return the marking of a crossing from its parameters; empty if there is none."""
    values = (row.get("value") for row in item.iterfind("param") if row.get("key") == "marking")
    return next(values, "")


def _allowed(item: etree._Element) -> tuple[str, ...]:
    allow, disallow = item.get("allow"), item.get("disallow")
    words = set((allow or disallow or "").split())
    if allow:
        return tuple(n for n, c in VEHICLE_CLASSES.items() if c in words or "all" in words)
    return tuple(n for n, c in VEHICLE_CLASSES.items() if c not in words and "all" not in words)


def _kind(function: str | None, allowed: tuple[str, ...]) -> str:
    if function in ("crossing", "walkingarea"):
        return function
    if function:
        return "connection"
    if "car" in allowed:
        return "driving"
    if "bus" in allowed:
        return "bus"
    if "bicycle" in allowed:
        return "bicycle"
    return "sidewalk" if "pedestrian" in allowed else "driving"


def _head(program: str, lane: Lane, links: list[int]) -> SignalHead:
    """Return the signal of a lane: at a vehicle lane's end, or at a crossing's start."""
    xy = lane.centre[:, :2]
    a, b = (xy[0], xy[1]) if lane.kind == "crossing" else (xy[-2], xy[-1])
    stop = a if lane.kind == "crossing" else b
    yaw = math.atan2(*(b - a)[::-1])
    return SignalHead(program, tuple(sorted(links)), lane.id, float(stop[0]), float(stop[1]), yaw)
