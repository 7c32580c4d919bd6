"""Findings about junctions: unmapped signals, crossings and turn lanes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import shapely

from urbantwin.geometry import wrapped
from urbantwin.roads.cross_section.lane_tags import count
from urbantwin.site.junction_proposal import JunctionArm, MappedJunction
from urbantwin.weakness.finding import Finding, Spot, counted, finding, spot
from urbantwin.weakness.mapped_site import MappedSite, MappedWay, nearness

__all__ = ["junction_findings"]

#: Weight of a street's class (`STREETS`) from which it is large, and medium.
_LARGE_WEIGHT, _MEDIUM_WEIGHT = 4.5, 3.0
#: Total number of lanes of all arms from which a junction of medium streets usually has signals.
_MANY_LANES = 9.0
#: Values of ``highway`` of nodes at junctions without signals.
_UNSIGNALISED_VALUES = ("stop", "give_way", "mini_roundabout")
#: Distance from the outermost node of a junction within which its crossings and signs lie, metres.
_REACH_M = 40.0
#: Maximum angle between a crossing and its arm, degrees.
_MAX_ARM_DEG = 30.0
#: Distance between junctions below which they have no crossings of their own between them, metres.
_NEIGHBOUR_M = 70.0
_PATH_KEYS = ("footway", "path", "cycleway")


def junction_findings(place: MappedSite) -> Iterator[Finding]:
    """Yield the findings about the junctions of the region."""
    signalised = [
        junction for junction in place.junctions if junction.signals or junction.crossing_signals
    ]
    unsignalised = [junction for junction in place.junctions if _looks_signalised(junction, place)]
    if unsignalised:
        nearest = max(nearness(shapely.Point(junction.middle)) for junction in unsignalised)
        names = _names(unsignalised[0]) if len(unsignalised) == 1 else ""
        where = f" ({names})" if names else ""
        yield finding(
            "signals-missing",
            counted(
                len(unsignalised),
                "junction without mapped signals looks",
                "junctions without mapped signals look",
            )
            + f" as if there were some{where}",
            share=nearest,
            count=len(unsignalised),
            of=len(place.junctions),
            spots=[_spot(place, junction) for junction in unsignalised],
        )
    yield from _crossings(place, signalised)
    yield from _turn_lanes(place, signalised)
    if signalised and not place.site.signals:
        yield finding(
            "signal-programs",
            "no program of the signals is given, of "
            + counted(len(signalised), "junction", "junctions"),
            count=len(signalised),
            of=len(signalised),
            where="signals",
        )


def _looks_signalised(junction: MappedJunction, place: MappedSite) -> bool:
    """Return whether a junction without mapped signals probably has some.

    It has three arms of large streets, or three of medium ones with many lanes, no signs of
    priority, and is no roundabout.
    """
    if junction.signals or junction.crossing_signals or len(junction.arms) < 3:
        return False
    tags = place.extract.node_tags
    street_ways = [
        street.way for street in place.streets if set(street.way.nodes) & set(junction.nodes)
    ]
    if any(
        street_way.tags.get("junction") in ("roundabout", "circular") for street_way in street_ways
    ):
        return False
    if any(
        street_way.tags["highway"] in ("motorway", "motorway_link") for street_way in street_ways
    ):
        return False
    around = _nodes_around(junction, place)
    if any(tags.get(node, {}).get("highway") in _UNSIGNALISED_VALUES for node in around):
        return False
    weights = sorted((arm.weight for arm in junction.arms), reverse=True)
    lanes = sum(arm.lanes for arm in junction.arms)
    return weights[2] >= _LARGE_WEIGHT or (weights[2] >= _MEDIUM_WEIGHT and lanes >= _MANY_LANES)


def _nodes_around(junction: MappedJunction, place: MappedSite) -> set[int]:
    """Return the nodes of streets near a junction."""
    disc = _junction_disc(junction, place)
    nodes = {
        node
        for street in place.streets
        if street.line.intersects(disc)
        for node in street.way.nodes
        if node in place.extract.nodes and node in place.extract.node_tags
    }
    if not nodes:
        return set()
    ordered = sorted(nodes)
    xy = place.frame.site_from_lonlat([place.extract.nodes[node] for node in ordered])
    inside = shapely.contains_xy(disc, xy[:, 0], xy[:, 1])
    return {node for node, is_inside in zip(ordered, inside, strict=True) if is_inside}


def _junction_disc(junction: MappedJunction, place: MappedSite) -> shapely.Polygon:
    nodes = [place.extract.nodes[node] for node in junction.nodes]
    xy = place.frame.site_from_lonlat(nodes)
    return shapely.MultiPoint(xy).convex_hull.buffer(_REACH_M)


def _crossings(place: MappedSite, signalised: list[MappedJunction]) -> Iterator[Finding]:
    """Yield a finding about arms of signalised junctions without a mapped crossing."""
    spots, arms, weak, all_of = [], 0, 0.0, 0.0
    mapped = _mapped_crossings(place)
    for junction in signalised:
        if len(junction.arms) < 3:
            continue
        disc = _junction_disc(junction, place)
        nearby = [point for point in mapped if disc.contains(point)]
        middle = shapely.Point(junction.middle)
        others = [candidate for candidate in place.junctions if candidate is not junction]
        for arm in junction.arms:
            if any(_leads_to(arm, junction, other) for other in others):
                continue
            arms += 1
            all_of += nearness(middle)
            if not any(_is_over(arm, junction, point) for point in nearby):
                weak += nearness(middle)
                spots.append(_spot_of_arm(place, junction, arm))
    if spots:
        yield finding(
            "crossings-missing",
            f"{len(spots)} of {arms} arms of junctions with signals have no mapped crossing",
            share=weak / all_of,
            count=len(spots),
            of=arms,
            spots=spots,
        )


def _mapped_crossings(place: MappedSite) -> list[shapely.Point]:
    """Return the mapped crossings: nodes of streets, and footways over streets."""
    tags, nodes = place.extract.node_tags, place.extract.nodes
    on_streets = {node for street in place.streets for node in street.way.nodes if node in nodes}
    marked = sorted(
        node
        for node in on_streets
        if tags.get(node, {}).get("highway") == "crossing"
        or tags.get(node, {}).get("crossing", "no") != "no"
    )
    points = []
    if marked:
        xy = place.frame.site_from_lonlat([nodes[node] for node in marked])
        points = list(shapely.points(xy))
    tree = shapely.STRtree([street.line for street in place.streets])
    for osm_way in place.extract.highways():
        if "crossing" not in [osm_way.tags.get(key) for key in _PATH_KEYS]:
            continue
        line = place.extract.way_line(osm_way, place.frame)
        if len(line) < 2:
            continue
        path = shapely.LineString(line)
        for number in tree.query(path, predicate="intersects").tolist():
            points.append(path.intersection(place.streets[number].line).centroid)
    return points


def _leads_to(arm: JunctionArm, junction: MappedJunction, other: MappedJunction) -> bool:
    """Return whether another junction is so near on an arm that both share a crossing."""
    point = shapely.Point(other.middle)
    away = float(point.distance(shapely.Point(junction.middle)))
    return away < _NEIGHBOUR_M and _is_over(arm, junction, point)


def _is_over(arm: JunctionArm, junction: MappedJunction, point: shapely.Point) -> bool:
    east, north = point.x - junction.middle[0], point.y - junction.middle[1]
    angle = float(np.degrees(np.arctan2(north, east)))
    return bool(abs(wrapped(angle - arm.angle_deg, 360.0)) <= _MAX_ARM_DEG)


def _turn_lanes(place: MappedSite, signalised: list[MappedJunction]) -> Iterator[Finding]:
    """Yield a finding about multi-lane approaches without turn lanes."""
    spots, approaches, weak, all_of = [], 0, 0.0, 0.0
    seen: set[int] = set()
    for junction in signalised:
        if len(junction.arms) < 3:
            continue
        cores = set(junction.nodes)
        for street in place.streets:
            for direction in _approaching(street, cores):
                lanes = _lanes_of(street, direction)
                if lanes is None or lanes < 2 or street.way.id in seen:
                    continue
                seen.add(street.way.id)
                approaches += 1
                weight = lanes * nearness(street.inside)
                all_of += weight
                keys = ("turn:lanes", f"turn:lanes:{direction}", f"turn:{direction}", "turn")
                if not any(key in street.way.tags for key in keys):
                    weak += weight
                    spots.append(street.spot(place.frame))
    if spots:
        yield finding(
            "turn-lanes",
            f"{len(spots)} of {approaches} approaches of two lanes and more, to signals, do not "
            "say which lane turns where",
            share=weak / all_of,
            count=len(spots),
            of=approaches,
            spots=spots,
        )


def _approaching(street: MappedWay, cores: set[int]) -> Iterator[str]:
    """Yield the directions in which a way leads into a junction, if it ends there."""
    tags = street.way.tags
    reverse, one_way = tags.get("oneway") == "-1", tags.get("oneway") in ("yes", "1", "true")
    first, last = street.way.nodes[0] in cores, street.way.nodes[-1] in cores
    if first and last:
        return  # within the junction
    if last and not reverse:
        yield "forward"
    if first and not one_way:
        yield "backward"


def _lanes_of(street: MappedWay, direction: str) -> int | None:
    """Return the number of mapped lanes in a direction."""
    tags = street.way.tags
    directed = count(tags.get(f"lanes:{direction}"))
    if directed is not None:
        return directed
    lanes = count(tags.get("lanes"))
    if lanes is None:
        return None
    return lanes if tags.get("oneway") in ("yes", "1", "-1", "true") else lanes // 2


def _names(junction: MappedJunction) -> str:
    named = sorted((arm for arm in junction.arms if arm.name), key=lambda arm: -arm.weight)
    return " / ".join(list(dict.fromkeys(arm.name for arm in named))[:2])


def _spot(place: MappedSite, junction: MappedJunction) -> Spot:
    xy = place.frame.site_from_lonlat([place.extract.nodes[junction.node]])[0]
    element = f"node/{junction.node}"
    name = _names(junction) or "junction"
    return spot(place.frame, shapely.Point(xy), element=element, name=name)


def _spot_of_arm(place: MappedSite, junction: MappedJunction, arm: JunctionArm) -> Spot:
    """Return a spot on an arm's way, where it leaves the junction."""
    nodes = place.frame.site_from_lonlat([place.extract.nodes[n] for n in junction.nodes])
    reach = float(np.linalg.norm(nodes - junction.middle, axis=1).max()) + 12.0
    angle = np.radians(arm.angle_deg)
    arm_point = shapely.Point(
        np.array(junction.middle) + reach * np.array([np.cos(angle), np.sin(angle)])
    )
    nearest = min(
        place.streets, key=lambda street: (street.line.distance(arm_point), street.way.id)
    )
    point = nearest.line.interpolate(nearest.line.project(arm_point))
    element = f"way/{nearest.way.id}"
    return spot(place.frame, point, element=element, name=arm.name or nearest.name)
