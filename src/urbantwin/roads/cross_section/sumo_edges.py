"""SUMO edges of cross sections: tags for netconvert, and edge shapes.

netconvert reads unambiguous tags correctly for lanes, turns and speeds. Properties that it ignores,
or reads differently for left-hand traffic, are set per edge: the line of the lanes (``placement``,
roads with unequal directions) and the permissions of each lane.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import SiteFrame
from urbantwin.roads.cross_section.layout import Middle
from urbantwin.roads.cross_section.section import CarriagewayLane, CrossSection
from urbantwin.roads.cross_section.segment import Segment
from urbantwin.site.access import CYCLE_TRACK
from urbantwin.site.extract import WayPiece

__all__ = ["SumoEdge", "sumo_edges", "sumo_tags", "write_sumo_edges"]

#: Tags unrelated to lanes, passed to netconvert unchanged.
KEPT = ("name", "ref", "layer", "junction", "bridge")
#: Classes that netconvert's type map lacks, with their substitutes.
CLASSES = {"road": "unclassified", CYCLE_TRACK: "cycleway"}
#: Vehicle classes of SUMO per class of actors.
VEHICLES = {
    "car": "private passenger hov taxi emergency authority army vip evehicle delivery custom1",
    "truck": "truck trailer",
    "bus": "bus coach",
    "motorcycle": "motorcycle moped",
    "bicycle": "bicycle",
    "pedestrian": "pedestrian",
}
#: Class of closed lanes: SUMO drops lanes without any permission.
NOBODY = "authority"


@dataclass(frozen=True, eq=False)
class SumoEdge:
    """One direction of a segment.

    Attributes:
        id: edge id in SUMO.
        lanes: from lane 0, at the curb, inwards, without the sidewalk.
        sidewalk: width of its sidewalk, which comes before the other lanes, metres; 0 for none.
        walkers: whether pedestrians use its outermost lane because there is no sidewalk.
        shape: (N, 2) line of the lanes, site frame; empty for the way itself.
        spread: ``right`` (lanes lie outwards of the shape) or ``center``.
    """

    id: str
    lanes: tuple[CarriagewayLane, ...]
    sidewalk: float
    walkers: bool
    shape: NDArray[np.float64]
    spread: str


def sumo_tags(segment: Segment, section: CrossSection) -> WayPiece:
    """Return a segment with tags from which netconvert builds its cross section."""
    old_tags = segment.piece.tags
    tags = {key: old_tags[key] for key in KEPT if key in old_tags}
    highway = old_tags.get("highway", "")
    tags["highway"] = CLASSES.get(highway, highway)
    own = section.kind == CYCLE_TRACK
    counted = {f: _counted(section.lanes(forward=f), own=own) for f in (True, False)}
    driven = {
        f: any(own or lane.kind != "bicycle" for lane in section.lanes(forward=f)) for f in counted
    }
    names = {True: "forward", False: "backward"}
    if all(driven.values()):
        tags["oneway"] = "no"
        tags["lanes"] = str(len(counted[True]) + len(counted[False]))
        tags["lanes:forward"] = str(len(counted[True]))
    else:
        only = not driven[False]
        tags["oneway"] = "yes" if only else "-1"
        tags["lanes"] = str(len(counted[only]))
    for forward, lanes in counted.items():
        ends = segment.last > 1 - 1e-9 if forward else segment.first < 1e-9
        if driven[forward] and ends and any(lane.turns for lane in lanes):
            # With left-hand traffic netconvert mirrors both the order and the arrows.
            mirror = section.driving_side == "left"
            values = [";".join(_turns(lane, mirror=mirror)) for lane in lanes]
            tags[f"turn:lanes:{names[forward]}"] = "|".join(values)
        widths = [lane.width for lane in section.lanes(forward=forward)]
        walk = section.side(forward=forward).sidewalk
        all_widths = [*widths, walk] if walk else widths
        if all_widths:
            # With left-hand traffic, lane 0 is the leftmost: netconvert reads widths from the left.
            ordered = all_widths if section.driving_side == "right" else all_widths[::-1]
            tags[f"width:lanes:{names[forward]}"] = "|".join(f"{w:.3f}" for w in ordered)
        # netconvert calls the forward edge right and the backward edge left, also with left-hand
        # traffic.
        side = "right" if forward else "left"
        has_own = len(lanes) < len(section.lanes(forward=forward))
        tags[f"cycleway:{side}"] = "lane" if has_own else "no"
    walks = [section.side(forward=f).sidewalk > 0 for f in (True, False)]
    tags["sidewalk"] = {
        (True, True): "both",
        (True, False): "right",
        (False, True): "left",
        (False, False): "no",
    }[walks[0], walks[1]]
    speeds = {f: [lane.speed for lane in lanes] for f, lanes in counted.items() if driven[f]}
    tags["maxspeed"] = f"{max(next(iter(speeds.values()), [50 / 3.6])) * 3.6:.4f}"
    if len(speeds) == 2:
        # On a one-way road this tag would make netconvert build the other direction.
        tags["maxspeed:backward"] = f"{max(speeds[False]) * 3.6:.4f}"
    return replace(segment.piece, tags=tags)


def sumo_edges(segment: Segment, section: CrossSection, middle: Middle) -> list[SumoEdge]:
    """Return the edges that netconvert makes of a segment, with their attributes.

    Args:
        segment: the part of a way.
        section: its cross section.
        middle: the middle of the road along it.
    """
    edges = []
    present = [f for f in (True, False) if _exists(section, forward=f)]
    for forward in present:
        lanes = section.lanes(forward=forward)
        walk = section.side(forward=forward).sidewalk
        spread, beside = "right", 0.0
        has_offset = bool(np.abs(middle.offset).max() > 1e-4)
        if len(present) == 1:
            # A one-way road is centred on its own middle, which gives better junctions.
            half = (sum(lane.width for lane in lanes) + walk) / 2
            spread, beside = "center", section.outward * half * (1 if forward else -1)
            has_offset = True
        line = middle.beside(beside)[:: 1 if forward else -1]
        identity = str(segment.piece.id) if forward else f"-{segment.piece.id}"
        shape = line if has_offset else np.zeros((0, 2))
        walkers = any("pedestrian" in lane.allowed for lane in lanes)
        edges.append(SumoEdge(identity, tuple(lanes[::-1]), walk, walkers, shape, spread))
    return edges


def write_sumo_edges(path: Path, frame: SiteFrame, edges: Sequence[SumoEdge]) -> None:
    """Write the attributes of edges for netconvert (``--edge-files``)."""
    root = ElementTree.Element("edges")
    for edge in edges:
        element = ElementTree.SubElement(root, "edge", id=edge.id)
        if len(edge.shape):
            lonlat = frame.lonlat_from_site(edge.shape)
            element.set("shape", " ".join(f"{lon:.9f},{lat:.9f}" for lon, lat in lonlat))
            element.set("spreadType", edge.spread)
        first = 1 if edge.sidewalk else 0
        outermost = next((k for k, x in enumerate(edge.lanes) if x.kind != "bicycle"), 0)
        for k, lane in enumerate(edge.lanes):
            allowed = [actor for actor in lane.allowed if actor != "pedestrian"]
            if edge.walkers and k == outermost:
                allowed.append("pedestrian")
            words = " ".join(VEHICLES[actor] for actor in allowed) or NOBODY
            ElementTree.SubElement(
                element, "lane", index=str(first + k), allow=words, speed=f"{lane.speed:.3f}"
            )
    ElementTree.indent(root)
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def _exists(section: CrossSection, *, forward: bool) -> bool:
    return bool(section.lanes(forward=forward) or section.side(forward=forward).sidewalk)


def _counted(lanes: Sequence[CarriagewayLane], *, own: bool) -> list[CarriagewayLane]:
    """Return the lanes that netconvert counts: all except an outer cycleway of a street.

    ``own`` is whether they belong to a separate way for bicycles.
    """
    beside = not own and lanes and lanes[-1].kind == "bicycle"
    return list(lanes[:-1] if beside else lanes)


def _turns(lane: CarriagewayLane, *, mirror: bool) -> tuple[str, ...]:
    swap = {"left": "right", "right": "left"}
    words = (turn.split("_") for turn in lane.turns)
    turns = ("_".join(swap.get(w, w) if mirror else w for w in word) for word in words)
    return tuple(turns) or ("none",)
