"""Findings about footways: those that lead nowhere, and ends that do not quite meet."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator

import numpy as np
import shapely
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from urbantwin.weakness.finding import Finding, counted, finding
from urbantwin.weakness.mapped_site import MappedSite, MappedWay, nearness
from urbantwin.weakness.place_in_editor import spot

__all__ = ["walking_findings"]

#: A way's end so near to another one was meant to meet it, metres.
_NEARLY_M = 2.0
#: Where the extract ends so near, ways end, too, metres.
_RIM_M = 15.0
#: Ways that are so short all together are steps to a door and the like, metres.
_SHORT_M = 15.0


def walking_findings(place: MappedSite) -> Iterator[Finding]:
    """Yield what is weak about the footways of the region."""
    if not place.footways:
        return
    others = [*place.footways, *place.streets, *_service(place)]
    apart = _apart(place, others)
    if apart:
        whole = sum(footway.weight for footway in place.footways)
        yield finding(
            "footways-apart",
            f"{len(apart)} of {len(place.footways)} footways share no node with the other ways",
            share=sum(footway.weight for footway in apart) / whole,
            count=len(apart),
            of=len(place.footways),
            spots=[footway.spot(place.frame) for footway in apart],
        )
    ends = _ends(place, others, {footway.way.id for footway in apart})
    if ends:
        share = sum(nearness(point) for _, _, point in ends) / 10.0
        yield finding(
            "footway-ends",
            counted(len(ends), "end of a footway lies", "ends of footways lie")
            + f" within {_NEARLY_M:g} m of a way that shares no node with "
            + ("it" if len(ends) == 1 else "them"),
            share=share,
            count=len(ends),
            spots=[
                spot(place.frame, point, element=f"node/{node}", name=footway.name)
                for footway, node, point in ends
            ],
        )


def _service(place: MappedSite) -> list[MappedWay]:
    """Return all other ways on which one may get on: service roads, tracks, cycleways, areas."""
    known = {one.way.id for one in (*place.footways, *place.streets)}
    found = []
    for way in place.extract.highways():
        points = place.extract.way_line(way, place.frame)
        if way.id in known or len(points) < 2:
            continue
        line = shapely.LineString(points)
        if line.intersects(place.region):
            found.append(MappedWay(way, line, shapely.intersection(line, place.region)))
    return found


def _apart(place: MappedSite, ways: list[MappedWay]) -> list[MappedWay]:
    """Return the footways from which no other way can be reached, within what is mapped."""
    numbers: dict[int, int] = {}
    pairs = []
    for way in ways:
        first = None
        for node in way.way.nodes:
            number = numbers.setdefault(node, len(numbers))
            if first is not None:
                pairs.append((first, number))
            first = number
    size = (len(numbers), len(numbers))
    rows = np.array(pairs, np.int64).reshape(-1, 2)
    graph = coo_array((np.ones(len(rows)), (rows[:, 0], rows[:, 1])), shape=size)
    labels = connected_components(graph, directed=False)[1]
    groups: defaultdict[int, list[MappedWay]] = defaultdict(list)
    for way in ways:
        groups[int(labels[numbers[way.way.nodes[0]]])].append(way)
    footways = {one.way.id for one in place.footways}
    inside = place.area.buffer(-_RIM_M)
    found = []
    for group in groups.values():
        lines = shapely.union_all([one.line for one in group])
        # What leaves the extract, or the region, may be joined beyond.
        whole = place.region.contains(lines) and inside.contains(lines)
        if whole and lines.length >= _SHORT_M and all(one.way.id in footways for one in group):
            found += group
    return sorted(found, key=lambda one: one.way.id)


def _ends(
    place: MappedSite, ways: list[MappedWay], apart: set[int]
) -> list[tuple[MappedWay, int, shapely.Point]]:
    """Return ends of footways that nearly meet another way of the same level."""
    uses: defaultdict[int, set[int]] = defaultdict(set)
    for way in ways:
        for node in way.way.nodes:
            uses[node].add(way.way.id)
    tree = shapely.STRtree([way.line for way in ways])
    found = []
    for footway in place.footways:
        if footway.way.id in apart or footway.way.nodes[0] == footway.way.nodes[-1]:
            continue
        for node in (footway.way.nodes[0], footway.way.nodes[-1]):
            if node not in place.extract.nodes or len(uses[node]) > 1:
                continue
            point = shapely.Point(place.frame.site_from_lonlat([place.extract.nodes[node]])[0])
            if not place.region.contains(point):
                continue
            near = tree.query(point, predicate="dwithin", distance=_NEARLY_M)
            if any(
                ways[number].way.id != footway.way.id and _level(ways[number]) == _level(footway)
                for number in near.tolist()
            ):
                found.append((footway, node, point))
    return found


def _level(way: MappedWay) -> tuple[str, bool, bool]:
    tags = way.way.tags
    return (
        tags.get("layer", "0"),
        tags.get("bridge", "no") != "no",
        tags.get("tunnel", "no") not in ("no", "building_passage"),
    )
