"""Links that are missing in a file, inferred from the positions of roads and lanes."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace

from urbantwin.roads.model import LaneSection, ModelJunction, ModelRoad, RoadLink, SectionLane
from urbantwin.roads.opendrive.cubics import value
from urbantwin.roads.opendrive.reading.junctions import (
    Poses,
    end_section,
    middles,
    with_road_link,
)
from urbantwin.roads.opendrive.reading.lane_sections import with_lane_links
from urbantwin.roads.opendrive.reading.parsing import Spot
from urbantwin.roads.opendrive.vocabulary import DRIVEN

__all__ = ["with_inferred_ends", "with_inferred_lanes"]

#: Maximum distance between the ends of a road and of a street that are linked, and of linked lanes,
#: metres.
ROADS_M, LANES_M = 1.0, 0.3
#: A narrower lane ends there, metres.
NO_WIDTH_M = 1e-3

_Lane = tuple[SectionLane, tuple[float, float]]


def with_inferred_ends(
    by_id: dict[int, ModelRoad],
    junctions: Iterable[ModelJunction],
    poses: Poses,
    spots: Mapping[int, Spot],
) -> None:
    """Link unlinked roads through junctions to the streets at their ends.

    Streets are linked to the junctions, too.

    Args:
        by_id: roads by id, changed in place.
        junctions: the junctions.
        poses: poses of the ends of roads.
        spots: roads, for remarks. A road through a junction that has traffic but leads nowhere is
            dropped.
    """
    _link_streets(by_id, spots)
    ends: dict[int, set[tuple[int, str]]] = {junction.id: set() for junction in junctions}
    for road in by_id.values():
        for end, link in (("start", road.predecessor), ("end", road.successor)):
            if link is not None and link.element == "junction" and link.id in ends:
                ends[link.id].add((road.id, end))
    for road in list(by_id.values()):
        if road.junction < 0:
            continue
        for tag, end in (("predecessor", "start"), ("successor", "end")):
            if getattr(road, tag) is not None:
                continue
            lanes = _lanes_at_end(road, end, poses, outwards=end == "end")
            candidates = [
                (gap, other, contact)
                for other, contact in ends.get(road.junction, ())
                if other in by_id and (gap := _gap(lanes, by_id[other], contact, poses)) < ROADS_M
            ]
            if candidates:
                _, other, contact = min(candidates)
                new_link = RoadLink("road", other, contact)
                by_id[road.id] = with_road_link(by_id[road.id], tag, new_link)
                spots[road.id].remark(
                    "roads through junctions without links: what they meet is taken"
                )
            elif any(lane.kind in DRIVEN for lane in end_section(road, end).lanes):
                spots[road.id].drop(f"leads through a junction, but has no {tag}")
                del by_id[road.id]
                break


def _link_streets(by_id: dict[int, ModelRoad], spots: Mapping[int, Spot]) -> None:
    """Link streets to the junctions whose roads link to them."""
    for road in list(by_id.values()):
        if road.junction < 0:
            continue
        for link in (road.predecessor, road.successor):
            if link is None or link.element != "road":
                continue
            street = by_id[link.id]
            existing = street.predecessor if link.contact == "start" else street.successor
            if street.junction >= 0 or existing is not None:
                continue
            spots[street.id].remark("streets that are not linked to the junction that they meet")
            new_link = RoadLink("junction", road.junction)
            tag = "predecessor" if link.contact == "start" else "successor"
            by_id[street.id] = with_road_link(street, tag, new_link)


def with_inferred_lanes(
    road: ModelRoad,
    by_id: Mapping[int, ModelRoad],
    poses: Poses,
    spot: Spot,
    *,
    wrong: Collection[tuple[int, str, int]] = (),
) -> ModelRoad:
    """Link unlinked lanes to the lanes whose ends coincide with theirs.

    Args:
        road: the road.
        by_id: roads by id.
        poses: poses of the ends of roads.
        spot: the road, for remarks.
        wrong: section number, ``predecessor`` or ``successor``, and lane of invalid links: these
            lanes are linked even if others of their section have links.
    """
    sections = list(road.sections)

    def of(k: int, tag: str) -> set[int]:
        return {lane for number, link_tag, lane in wrong if (number, link_tag) == (k, tag)}

    for k in range(len(sections) - 1):
        before = _open_lanes(road, sections[k], road.section_ends[k])
        after = _open_lanes(road, sections[k + 1], sections[k + 1].s)
        sections[k] = _linked_section(
            sections[k], "successor", before, after, spot, of(k, "successor")
        )
        sections[k + 1] = _linked_section(
            sections[k + 1], "predecessor", after, before, spot, of(k + 1, "predecessor")
        )
        sections[k] = _linked_back(sections[k], "successor", sections[k + 1])
        sections[k + 1] = _linked_back(sections[k + 1], "predecessor", sections[k])
    last = len(sections) - 1
    for tag, end, k in (("predecessor", "start", 0), ("successor", "end", last)):
        link = getattr(road, tag)
        if link is None or link.element != "road":
            continue
        if _is_linked(sections[k], tag) and not of(k, tag):
            continue
        other = by_id[link.id]
        own_lanes = _lanes_at_end(
            replace(road, sections=tuple(sections)), end, poses, outwards=end == "end"
        )
        other_lanes = _lanes_at_end(other, link.contact, poses, outwards=link.contact == "start")
        sections[k] = _linked_section(sections[k], tag, own_lanes, other_lanes, spot, of(k, tag))
    return replace(road, sections=tuple(sections))


def _is_linked(section: LaneSection, tag: str) -> bool:
    return any(getattr(lane, tag) is not None for lane in section.lanes)


def _linked_back(section: LaneSection, tag: str, other: LaneSection) -> LaneSection:
    """Return a section whose unlinked lanes are linked back to lanes that are linked to them."""
    back = "successor" if tag == "predecessor" else "predecessor"
    links = {getattr(lane, back): lane for lane in reversed(other.lanes) if lane.kind in DRIVEN}
    new_links = {
        lane.id: links[lane.id].id
        for lane in section.lanes
        if lane.kind in DRIVEN
        and getattr(lane, tag) is None
        and lane.id in links
        and links[lane.id].forward == lane.forward
    }
    return _with_links(section, tag, new_links)


def _with_links(section: LaneSection, tag: str, links: Mapping[int, int]) -> LaneSection:
    """Return a section with given links by lane id; other lanes keep theirs."""
    return with_lane_links(section, tag, lambda lane, link: links.get(lane.id, link))


def _open_lanes(road: ModelRoad, section: LaneSection, s: float) -> dict[int, _Lane]:
    """Return the lanes of a section open at a station, with their lateral position."""
    lanes = {}
    for sign in (1, -1):
        t = value(road.offset, s)
        for number in range(1, len(section.lanes) + 1):
            lane = section.by_id.get(sign * number)
            if lane is None:
                break
            width = value(lane.width, s - section.s)
            if lane.kind in DRIVEN and width > NO_WIDTH_M:
                along = 1.0 if lane.forward else -1.0
                # Lanes of opposite directions must not match: they are kept 100 m apart.
                lanes[lane.id] = (lane, (t + sign * width / 2, 100.0 * along))
            t += sign * width
    return lanes


def _lanes_at_end(road: ModelRoad, end: str, poses: Poses, *, outwards: bool) -> dict[int, _Lane]:
    """Return driven lanes at an end of a road; those not ``outwards`` are placed far away."""
    places = middles(road, end, poses)
    lanes = {}
    for lane in end_section(road, end).lanes:
        x, y = places[lane.id]
        if lane.kind in DRIVEN:
            lanes[lane.id] = (lane, (x + (0.0 if lane.forward == outwards else 1e7), y))
    return lanes


def _gap(mine: Mapping[int, _Lane], other: ModelRoad, contact: str, poses: Poses) -> float:
    """Return the distance to the nearest lanes that could continue the given ones, metres."""
    other_lanes = _lanes_at_end(other, contact, poses, outwards=contact == "start")
    return min(
        (math.dist(a, b) for _, a in mine.values() for _, b in other_lanes.values()),
        default=math.inf,
    )


def _linked_section(
    section: LaneSection,
    tag: str,
    mine: Mapping[int, _Lane],
    theirs: Mapping[int, _Lane],
    spot: Spot,
    wrong: Collection[int],
) -> LaneSection:
    """Return a section whose lanes are linked to the nearest lanes of another.

    If none has a link, all are linked; else those whose own links are ``wrong``.
    """
    linked = _is_linked(section, tag)
    if not theirs:
        return section
    links: dict[int, int] = {}
    for identity, (_, place) in mine.items():
        if linked and identity not in wrong:
            continue
        gap, other = min((math.dist(place, target), key) for key, (_, target) in theirs.items())
        if gap < LANES_M:
            links[identity] = other
    if not links:
        return section
    spot.remark("lanes without links: they go on as the lanes that they meet")
    return _with_links(section, tag, links)
