"""SUMO's edges of cross sections: tags that netconvert reads as meant, and edges' shapes.

netconvert gets lanes, turns and speeds right if the tags are unambiguous. What it does not read, or
reads differently for left-hand traffic, is given for each edge by name: the line that the lanes run
along (``placement``, roads with more lanes in one direction) and who may use a lane.
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

#: Tags that do not speak of lanes and go to netconvert as they are.
KEPT = ("name", "ref", "layer", "junction", "bridge")
#: Classes that netconvert's type map does not know, and what they are to it.
CLASSES = {"road": "unclassified", CYCLE_TRACK: "cycleway"}
#: SUMO's vehicle classes of our classes of actors.
VEHICLES = {
    "car": "private passenger hov taxi emergency authority army vip evehicle delivery custom1",
    "truck": "truck trailer",
    "bus": "bus coach",
    "motorcycle": "motorcycle moped",
    "bicycle": "bicycle",
    "pedestrian": "pedestrian",
}
#: Lanes that are closed to everybody keep one class, without which SUMO has no lane.
NOBODY = "authority"


@dataclass(frozen=True, eq=False)
class SumoEdge:
    """One direction of a segment.

    Attributes:
        id: its name in SUMO.
        lanes: from lane 0, at the curb, inwards, without the sidewalk.
        sidewalk: width of its sidewalk, which comes before the other lanes; 0 for none.
        shape: (N, 2) the line that lanes are laid along, site frame; empty for the way itself.
        walkers: whether people walk on its outermost lane because there is no sidewalk.
        spread: ``right`` (lanes lie outwards of the shape) or ``center``.
    """

    id: str
    lanes: tuple[CarriagewayLane, ...]
    sidewalk: float
    walkers: bool
    shape: NDArray[np.float64]
    spread: str


def sumo_tags(segment: Segment, section: CrossSection) -> WayPiece:
    """Return a segment with the tags that make netconvert build its cross section."""
    old = segment.piece.tags
    tags = {key: old[key] for key in KEPT if key in old}
    highway = old.get("highway", "")
    tags["highway"] = CLASSES.get(highway, highway)
    own = section.kind == CYCLE_TRACK
    counted = {f: _counted(section.lanes(forward=f), own=own) for f in (True, False)}
    driven = {f: any(own or x.kind != "bicycle" for x in section.lanes(forward=f)) for f in counted}
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
            # On the left, netconvert reads the mirror image: both the order and the arrows.
            mirror = section.driving_side == "left"
            values = [";".join(_turns(lane, mirror=mirror)) for lane in lanes]
            tags[f"turn:lanes:{names[forward]}"] = "|".join(values)
        widths = [lane.width for lane in section.lanes(forward=forward)]
        walk = section.side(forward=forward).sidewalk
        everything = [*widths, walk] if walk else widths
        if everything:
            # On the left, lane 0 is the leftmost: netconvert takes widths from the left there.
            ordered = everything if section.driving_side == "right" else everything[::-1]
            tags[f"width:lanes:{names[forward]}"] = "|".join(f"{w:.3f}" for w in ordered)
        # netconvert calls the forward edge right and the backward one left, on the left as well.
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
        middle: where the middle of the road runs.
    """
    found = []
    present = [f for f in (True, False) if _exists(section, forward=f)]
    for forward in present:
        lanes = section.lanes(forward=forward)
        walk = section.side(forward=forward).sidewalk
        spread, beside = "right", 0.0
        moved = bool(np.abs(middle.offset).max() > 1e-4)
        if len(present) == 1:
            # A road of one direction is laid around its own middle: junctions look better.
            half = (sum(lane.width for lane in lanes) + walk) / 2
            spread, beside = "center", section.outward * half * (1 if forward else -1)
            moved = True
        line = middle.beside(beside)[:: 1 if forward else -1]
        identity = str(segment.piece.id) if forward else f"-{segment.piece.id}"
        shape = line if moved else np.zeros((0, 2))
        walkers = any("pedestrian" in lane.allowed for lane in lanes)
        found.append(SumoEdge(identity, tuple(lanes[::-1]), walk, walkers, shape, spread))
    return found


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
    """Return the lanes that netconvert counts: not the cycleway at the outer side of a street.

    ``own``: whether they are a way for bicycles of its own.
    """
    beside = not own and lanes and lanes[-1].kind == "bicycle"
    return list(lanes[:-1] if beside else lanes)


def _turns(lane: CarriagewayLane, *, mirror: bool) -> tuple[str, ...]:
    swap = {"left": "right", "right": "left"}
    words = (turn.split("_") for turn in lane.turns)
    turns = ("_".join(swap.get(w, w) if mirror else w for w in word) for word in words)
    return tuple(turns) or ("none",)
