"""Findings about streets: tags that they lack."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

import shapely

from urbantwin.roads.cross_section.lane_tags import count
from urbantwin.weakness.finding import Finding, finding
from urbantwin.weakness.mapped_site import MappedSite, MappedWay

__all__ = ["street_findings"]

Tags = Mapping[str, str]

_LANES = ("lanes", "lanes:forward", "lanes:backward")
_SPEEDS = ("maxspeed", "maxspeed:forward", "maxspeed:backward", "maxspeed:type", "zone:maxspeed",
           "source:maxspeed", "zone:traffic")  # fmt: skip
_SIDEWALKS = ("sidewalk", "sidewalk:both", "sidewalk:left", "sidewalk:right")
#: Streets beside which nobody expects a sidewalk.
_NO_SIDEWALK = ("motorway", "motorway_link", "trunk_link", "busway", "living_street")
#: A footway so near to the middle of a street, along so much of it, is its sidewalk, metres.
_BESIDE_M, _ALONG = 18.0, 0.5


def street_findings(place: MappedSite) -> Iterator[Finding]:
    """Yield what is weak about the streets of the region."""
    tags: tuple[tuple[str, str, Callable[[Tags], bool]], ...] = (
        ("lanes", "do not say how many lanes they have", _lacks_lanes),
        ("maxspeed", "have no speed limit", _lacks_speed),
        ("surface", "have no surface", lambda tags: "surface" not in tags),
    )
    for kind, problem, is_weak in tags:
        weak = [street for street in place.streets if is_weak(street.way.tags)]
        yield from _of_streets(place, kind, problem, weak, place.streets)
    walks = shapely.union_all([footway.line for footway in place.footways]).buffer(_BESIDE_M)
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
    return bool(along < _ALONG * street.inside.length)
