"""Parking, shoulders and sidewalks beside the lanes."""

from __future__ import annotations

from collections.abc import Mapping

from urbantwin.roads.cross_section.defaults import Standard
from urbantwin.roads.cross_section.lane_tags import metres
from urbantwin.roads.cross_section.section import Parking, Roadside

__all__ = ["parking", "roadside"]

ORIENTATIONS = ("parallel", "diagonal", "perpendicular")
FORBIDDEN = frozenset({"no_parking", "no_stopping", "no_standing", "fire_lane"})
#: Positions of parked cars, with the share of the parking depth on the carriageway's side of the
#: curb.
POSITIONS = {
    "lane": 1.0,
    "yes": 1.0,
    "street_side": 1.0,
    "shoulder": 1.0,
    "half_on_kerb": 0.5,
    "on_kerb": 0.0,
}
#: Positions in the tagging scheme before 2022.
FORMER = {"on_street": "lane", "lay_by": "street_side", "painted_area_only": "lane"}
#: Speed above which roads of some classes have shoulders, m/s (70 km/h).
FAST = 19.0
NARROWEST_WALK_M, WIDEST_WALK_M = 0.8, 15.0


def parking(tags: Mapping[str, str], side: str, standard: Standard) -> Parking | None:
    """Return the parking of one side (OSM wiki, "Street parking"), also in the former scheme.

    Parking that is mapped as a separate area (``separate``) is not part of the road.
    """
    parked = _present(tags, side) or _former(tags, side)
    if parked is None:
        return None
    position, orientation = parked
    share = POSITIONS.get(position)
    if share is None:
        return None
    keys = (f"parking:{side}:width", "parking:both:width")
    former = (f"parking:lane:{side}:width", "parking:lane:both:width")
    width = _first_length(tags, (*keys, *former)) or standard.parking(orientation)
    width = min(max(width, 1.5), 7.0) * share
    return Parking(orientation, width, position) if width > 0 else None


def roadside(
    tags: Mapping[str, str],
    side: str,
    *,
    sidewalk: bool,
    outer: bool,
    standard: Standard,
    speed: float,
) -> Roadside:
    """Return the roadside on one side of a way.

    Args:
        tags: the way's tags.
        side: ``left`` or ``right``, as seen along the way.
        sidewalk: whether there is a sidewalk.
        outer: whether it is the outer side of its traffic, not the inner side of a one-way road.
        standard: default widths.
        speed: speed limit, m/s.
    """
    keys = (f"sidewalk:{side}:width", "sidewalk:both:width", "sidewalk:width")
    width = _first_length(tags, keys) or standard.sidewalk
    walk = min(max(width, NARROWEST_WALK_M), WIDEST_WALK_M) if sidewalk else 0.0
    return Roadside(
        parking(tags, side, standard),
        _shoulder(tags, side, standard, speed if outer and not sidewalk else 0.0),
        walk,
    )


def _present(tags: Mapping[str, str], side: str) -> tuple[str, str] | None:
    value = tags.get(f"parking:{side}", tags.get("parking:both"))
    if value is None or value in ("no", "separate"):
        return None

    def of(key: str) -> str | None:
        return tags.get(f"parking:{side}:{key}", tags.get(f"parking:both:{key}"))

    if of("restriction") in FORBIDDEN:
        return None
    orientation = of("orientation")
    return value, orientation if orientation in ORIENTATIONS else "parallel"


def _former(tags: Mapping[str, str], side: str) -> tuple[str, str] | None:
    value = tags.get(f"parking:lane:{side}", tags.get("parking:lane:both"))
    if value is None or value in ("no", "none", "separate") or value in FORBIDDEN:
        return None
    orientation = value if value in ORIENTATIONS else "parallel"
    position = tags.get(
        f"parking:lane:{side}:{orientation}", tags.get(f"parking:lane:both:{orientation}", "lane")
    )
    return FORMER.get(position, position), orientation


def _shoulder(tags: Mapping[str, str], side: str, standard: Standard, speed: float) -> float:
    both_sides = tags.get("shoulder:both", tags.get("shoulder"))
    tag = tags.get(f"shoulder:{side}")
    if tag is None and both_sides is not None:
        tag = {"both": "yes", "left": "no", "right": "no", side: "yes"}.get(both_sides, both_sides)
    width = _first_length(tags, (f"shoulder:{side}:width", "shoulder:both:width", "shoulder:width"))
    highway = tags.get("highway", "")
    fast = highway in ("motorway", "motorway_link", "trunk") and speed > FAST
    default_m = standard.shoulder if highway in ("motorway", "trunk") else standard.minor_shoulder
    if tag is None:
        return default_m if fast else 0.0
    return 0.0 if tag in ("no", "none") else min(width or default_m, 5.0)


def _first_length(tags: Mapping[str, str], keys: tuple[str, ...]) -> float | None:
    return next((length for key in keys if (length := metres(tags.get(key))) is not None), None)
