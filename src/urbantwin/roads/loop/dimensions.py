"""Dimensions of outer roads: tags, widths and radii after the streets that they join."""

from __future__ import annotations

from collections.abc import Mapping

from urbantwin.site.access import either_way

__all__ = ["CLEARANCE_M", "half_width", "outer_tags", "turning_radius"]

#: Widths that roads need in plan, metres.
SIDEWALK_M, CYCLE_LANE_M = 2.5, 1.5
#: Room beside a road, metres.
CLEARANCE_M = 1.5
#: Radius of the inner border where vehicles turn round, metres: a 12 m bus has to pass between
#: circles of 5.3 and 12.5 m (Directive 97/27/EC, annex I, 7.6.1), its middle near 8 m.
INNER_M = 9.0
#: Tags of a street that its outer road has too.
KEPT = ("highway", "motorroad", "surface")


def turning_radius(carriageway_m: float) -> float:
    """Return the radius of the middle of a road on which vehicles turn round, metres."""
    return INNER_M + carriageway_m / 2


def half_width(carriageway_m: float, tags: Mapping[str, str]) -> float:
    """Return how far a road reaches to its sides, sidewalks and cycle lane included, metres."""
    width = carriageway_m / 2
    width += SIDEWALK_M if tags.get("sidewalk", "no") != "no" else 0.0
    return width + (CYCLE_LANE_M if _has_cycle_lane(tags) else 0.0)


def outer_tags(
    street: Mapping[str, str],
    lanes: int,
    lane_m: float,
    *,
    side: str,
    kmh: int,
    sidewalks: str,
) -> dict[str, str]:
    """Return the tags of a one-way outer road.

    Args:
        street: tags of the street that it goes on from, ``sidewalk`` filled in.
        lanes: how many lanes it has.
        lane_m: how wide they are, metres; as wide as the street's, because SUMO's two-wheelers
            get stuck beside cars where lanes become narrower.
        side: ``right`` or ``left``, the side that traffic keeps to.
        kmh: the speed that its bends allow.
        sidewalks: on which sides it has sidewalks where the street has any.
    """
    tags = {key: street[key] for key in KEPT if key in street} | either_way(street)
    tags |= {"oneway": "yes", "lanes": str(lanes), "maxspeed": str(kmh)}
    tags["width:lanes"] = "|".join([f"{lane_m:.2f}"] * lanes)
    tags["sidewalk"] = "no" if street.get("sidewalk", "no") == "no" else sidewalks
    if _has_cycle_lane(street):
        tags[f"cycleway:{side}"] = "lane"
    return tags


def _has_cycle_lane(tags: Mapping[str, str]) -> bool:
    return any(
        value in ("lane", "track", "opposite_lane", "opposite_track")
        for key, value in tags.items()
        if key.split(":")[0] == "cycleway"
    )
