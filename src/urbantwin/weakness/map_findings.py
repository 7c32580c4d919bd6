"""Findings about the map along streets: lanes, footways, buildings, trees and lamps."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np
import shapely
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from urbantwin.roads.cross_section.lane_tags import count
from urbantwin.scene.building_height import building_rise
from urbantwin.scene.building_outline import MappedBuilding, mapped_buildings
from urbantwin.site.corrections import AddPole, AddTree
from urbantwin.weakness.finding import Finding, counted, finding, spot
from urbantwin.weakness.mapped_site import MappedSite, MappedWay, nearness

__all__ = ["building_findings", "furniture_findings", "street_findings", "walking_findings"]

#: Key under which guessed heights of buildings are counted.
_ASSUMED = "height assumed from building type"


def building_findings(place: MappedSite) -> Iterator[Finding]:
    """Yield the findings about the buildings of the region, as the scene would build them."""
    buildings = mapped_buildings(place.features, place.region, None, Counter())
    # Imported geometry replaces an unknown number of the map's buildings.
    share = 0.5 if place.site.geometry else 1.0
    if not buildings:
        yield finding("buildings-missing", "no building is mapped in the region", share=share)
        return
    elements = {
        (item.id, item.tags.get("building"), item.tags.get("building:part")): item.kind
        for item in place.features
        if "building" in item.tags or "building:part" in item.tags
    }
    spots, weak, all_of = [], 0.0, 0.0
    for building in buildings:
        plan = building.plan()
        # What a wall hides grows with the side length of a house, not with its area.
        weight = plan.area**0.5 * nearness(plan)
        all_of += weight
        if _has_height(building):
            continue
        weak += weight
        tags = building.tags
        kind = elements.get((building.id, tags.get("building"), tags.get("building:part")), "way")
        name = tags.get("name") or " ".join(
            tags[key] for key in ("addr:street", "addr:housenumber") if key in tags
        )
        kinds = tags.get("building", "yes")
        word = "building" if kinds == "yes" else kinds.replace("_", " ")
        shape = max(shapely.get_parts(plan), key=lambda part: part.area)
        element = "" if building.id in place.added else f"{kind}/{building.id}"
        spots.append(spot(place.frame, shape, element=element, name=name or word))
    if spots:
        yield finding(
            "building-heights",
            f"{len(spots)} of {len(buildings)} buildings have neither a height nor storeys",
            share=share * weak / all_of,
            count=len(spots),
            of=len(buildings),
            spots=spots,
        )


def _has_height(building: MappedBuilding) -> bool:
    """Return whether the map gives the height of a building or of a part of it."""
    tags = [part for part, _ in building.parts] or [building.tags]
    for part_tags in tags:
        notes: Counter[str] = Counter()
        building_rise(part_tags, building.tags, 100.0, notes)
        if not notes[_ASSUMED]:
            return True
    return False


#: Kinds of corrected poles that are lamps or carry wires.
_POLES = ("lamp", "utility")
_TREES = ("tree", "tree_row", "tree_group", "wood", "scrub")


def furniture_findings(place: MappedSite) -> Iterator[Finding]:
    """Yield a finding for each kind of object without any in the region."""
    added = [correction.asked for correction in place.corrections]
    anchor_spot = [spot(place.frame, shapely.Point(0.0, 0.0), name="the anchor")]
    tags = [item.tags for item in place.features]
    if not any(isinstance(correction, AddTree) for correction in added) and not any(
        feature_tags.get("natural") in _TREES or feature_tags.get("landuse") == "forest"
        for feature_tags in tags
    ):
        yield finding("trees-missing", "no tree is mapped in the region", spots=anchor_spot)
    if not any(
        isinstance(correction, AddPole) and correction.kind in _POLES for correction in added
    ) and not any(
        feature_tags.get("highway") == "street_lamp"
        or feature_tags.get("power") in ("pole", "tower", "catenary_mast")
        or feature_tags.get("man_made") in ("street_lamp", "utility_pole")
        for feature_tags in tags
    ):
        lit = [street for street in place.streets if street.way.tags.get("lit") == "no"]
        share = 1.0 - len(lit) / max(len(place.streets), 1)
        if share > 0:
            problem = "neither street lamps nor poles are mapped in the region"
            yield finding("lamps-missing", problem, share=share, spots=anchor_spot)


Tags = Mapping[str, str]

_LANES = ("lanes", "lanes:forward", "lanes:backward")
_SPEEDS = ("maxspeed", "maxspeed:forward", "maxspeed:backward", "maxspeed:type", "zone:maxspeed",
           "source:maxspeed", "zone:traffic")  # fmt: skip
_SIDEWALKS = ("sidewalk", "sidewalk:both", "sidewalk:left", "sidewalk:right")
#: Streets without expected sidewalks.
_NO_SIDEWALK = ("motorway", "motorway_link", "trunk_link", "busway", "living_street")
#: Maximum distance of a footway from the middle of a street, metres, and least share along it, to
#: be its sidewalk.
_SIDEWALK_DISTANCE_M, _SIDEWALK_SHARE = 18.0, 0.5


def street_findings(place: MappedSite) -> Iterator[Finding]:
    """Yield the findings about the streets of the region."""
    tags: tuple[tuple[str, str, Callable[[Tags], bool]], ...] = (
        ("lanes", "do not say how many lanes they have", _lacks_lanes),
        ("maxspeed", "have no speed limit", _lacks_speed),
        ("surface", "have no surface", lambda tags: "surface" not in tags),
    )
    for kind, problem, is_weak in tags:
        weak = [street for street in place.streets if is_weak(street.way.tags)]
        yield from _of_streets(place, kind, problem, weak, place.streets)
    walks = shapely.union_all([footway.line for footway in place.footways]).buffer(
        _SIDEWALK_DISTANCE_M
    )
    beside = [street for street in place.streets if _may_have_sidewalk(street.way.tags)]
    weak = [street for street in beside if _sidewalk_unknown(street, walks)]
    problem = "do not say whether they have sidewalks"
    yield from _of_streets(place, "sidewalks", problem, weak, beside)


def _of_streets(
    place: MappedSite,
    kind: str,
    problem: str,
    weak: Sequence[MappedWay],
    streets: Sequence[MappedWay],
) -> Iterator[Finding]:
    if not weak:
        return
    metres = sum(street.inside.length for street in weak)
    yield finding(
        kind,
        f"{len(weak)} of {len(streets)} ways of streets, {metres:.0f} m, {problem}",
        share=sum(street.weight for street in weak) / sum(street.weight for street in streets),
        count=len(weak),
        of=len(streets),
        spots=[street.spot(place.frame) for street in weak],
    )


def _lacks_lanes(tags: Tags) -> bool:
    return all(count(tags.get(key)) is None for key in _LANES) and "lane_markings" not in tags


def _lacks_speed(tags: Tags) -> bool:
    return not any(key in tags for key in _SPEEDS) and tags["highway"] != "living_street"


def _may_have_sidewalk(tags: Tags) -> bool:
    if tags["highway"] in _NO_SIDEWALK or tags.get("junction") in ("roundabout", "circular"):
        return False
    return tags.get("foot") not in ("no", "use_sidepath") and tags.get("motorroad") != "yes"


def _sidewalk_unknown(street: MappedWay, walks: shapely.Geometry) -> bool:
    if any(key in street.way.tags for key in _SIDEWALKS):
        return False
    along = shapely.intersection(street.inside, walks).length
    return bool(along < _SIDEWALK_SHARE * street.inside.length)


#: Distance within which the end of a way was probably meant to join another, metres.
_NEARLY_JOINED_M = 2.0
#: Distance from the extract's border within which ways may be cut, metres.
_BORDER_M = 15.0
#: Total length below which a group of ways is ignored, such as steps to a door, metres.
_MIN_GROUP_M = 15.0


def walking_findings(place: MappedSite) -> Iterator[Finding]:
    """Yield the findings about the footways of the region."""
    if not place.footways:
        return
    others = [*place.footways, *place.streets, *_other_ways(place)]
    apart = _isolated_footways(place, others)
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
    ends = _loose_footway_ends(place, others, {footway.way.id for footway in apart})
    if ends:
        share = sum(nearness(point) for _, _, point in ends) / 10.0
        yield finding(
            "footway-ends",
            counted(len(ends), "end of a footway lies", "ends of footways lie")
            + f" within {_NEARLY_JOINED_M:g} m of a way that shares no node with "
            + ("it" if len(ends) == 1 else "them"),
            share=share,
            count=len(ends),
            spots=[
                spot(place.frame, point, element=f"node/{node}", name=footway.name)
                for footway, node, point in ends
            ],
        )


def _other_ways(place: MappedSite) -> list[MappedWay]:
    """Return all other ways that connect to footways: service roads, tracks, cycleways, areas."""
    known_ids = {mapped.way.id for mapped in (*place.footways, *place.streets)}
    other_ways = []
    for osm_way in place.extract.highways():
        points = place.extract.way_line(osm_way, place.frame)
        if osm_way.id in known_ids or len(points) < 2:
            continue
        line = shapely.LineString(points)
        if line.intersects(place.region):
            other_ways.append(MappedWay(osm_way, line, shapely.intersection(line, place.region)))
    return other_ways


def _isolated_footways(place: MappedSite, ways: list[MappedWay]) -> list[MappedWay]:
    """Return the footways from which no other way can be reached, within the map."""
    numbers: dict[int, int] = {}
    pairs = []
    for footway in ways:
        first = None
        for node in footway.way.nodes:
            number = numbers.setdefault(node, len(numbers))
            if first is not None:
                pairs.append((first, number))
            first = number
    size = (len(numbers), len(numbers))
    rows = np.array(pairs, np.int64).reshape(-1, 2)
    graph = coo_array((np.ones(len(rows)), (rows[:, 0], rows[:, 1])), shape=size)
    labels = connected_components(graph, directed=False)[1]
    groups: defaultdict[int, list[MappedWay]] = defaultdict(list)
    for footway in ways:
        groups[int(labels[numbers[footway.way.nodes[0]]])].append(footway)
    footways = {footway.way.id for footway in place.footways}
    inside = place.area.buffer(-_BORDER_M)
    isolated = []
    for group in groups.values():
        lines = shapely.union_all([footway.line for footway in group])
        # Ways that leave the extract, or the region, may be joined beyond.
        whole = place.region.contains(lines) and inside.contains(lines)
        if (
            whole
            and lines.length >= _MIN_GROUP_M
            and all(footway.way.id in footways for footway in group)
        ):
            isolated += group
    return sorted(isolated, key=lambda footway: footway.way.id)


def _loose_footway_ends(
    place: MappedSite, ways: list[MappedWay], apart: set[int]
) -> list[tuple[MappedWay, int, shapely.Point]]:
    """Return ends of footways that nearly meet another way of the same level."""
    uses: defaultdict[int, set[int]] = defaultdict(set)
    for mapped in ways:
        for node in mapped.way.nodes:
            uses[node].add(mapped.way.id)
    tree = shapely.STRtree([mapped.line for mapped in ways])
    loose_ends = []
    for footway in place.footways:
        if footway.way.id in apart or footway.way.nodes[0] == footway.way.nodes[-1]:
            continue
        for node in (footway.way.nodes[0], footway.way.nodes[-1]):
            if node not in place.extract.nodes or len(uses[node]) > 1:
                continue
            point = shapely.Point(place.frame.site_from_lonlat([place.extract.nodes[node]])[0])
            if not place.region.contains(point):
                continue
            nearby = tree.query(point, predicate="dwithin", distance=_NEARLY_JOINED_M)
            if any(
                ways[number].way.id != footway.way.id and _level(ways[number]) == _level(footway)
                for number in nearby.tolist()
            ):
                loose_ends.append((footway, node, point))
    return loose_ends


def _level(way: MappedWay) -> tuple[str, bool, bool]:
    tags = way.way.tags
    return (
        tags.get("layer", "0"),
        tags.get("bridge", "no") != "no",
        tags.get("tunnel", "no") not in ("no", "building_passage"),
    )
