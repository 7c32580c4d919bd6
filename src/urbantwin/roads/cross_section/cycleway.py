"""Cycle lanes and tracks beside the lanes of motor traffic."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from urbantwin.roads.cross_section.defaults import Standard
from urbantwin.roads.cross_section.lane_tags import metres

__all__ = ["Cycleway", "Cycleways", "cycleways"]

#: Values for a lane on the carriageway, and for a track beside it. A track that is mapped as a
#: separate way is also part of the street: such ways are not in the network themselves.
LANE = frozenset({"lane", "yes", "opposite_lane"})
TRACK = frozenset({"track", "opposite_track", "separate", "sidepath", "use_sidepath"})


@dataclass(frozen=True)
class Cycleway:
    """A cycle lane, or a ``track`` separate from the carriageway; ``width`` in metres."""

    width: float
    track: bool


@dataclass(frozen=True)
class Cycleways:
    """Cycleways of a road.

    Attributes:
        forward, backward: at the outer side of each direction.
        inner: at the inner side of a one-way road, in the direction of its traffic.
    """

    forward: Cycleway | None = None
    backward: Cycleway | None = None
    inner: Cycleway | None = None


def cycleways(
    tags: Mapping[str, str], way: str, driving_side: str, standard: Standard
) -> Cycleways:
    """Return the cycleways of a way (OSM wiki, "Key:cycleway").

    Args:
        tags: the way's tags.
        way: directions of traffic: ``forward``, ``backward`` or ``both``.
        driving_side: ``right`` or ``left``.
        standard: default widths.
    """
    sides = {side: _side(tags, side, way, driving_side, standard) for side in ("left", "right")}
    other = "left" if driving_side == "right" else "right"
    if way == "both":
        return Cycleways(sides[driving_side], sides[other])
    # Seen along the traffic, a one-way road against its OSM way has its sides swapped.
    outer, inner = (driving_side, other) if way == "forward" else (other, driving_side)
    if sides[inner] is None or not _is_contraflow(tags, inner):
        against, same = None, sides[inner]
    else:
        against, same = sides[inner], None
    if way == "forward":
        return Cycleways(sides[outer], against, same)
    return Cycleways(against, sides[outer], same)


def _side(
    tags: Mapping[str, str], side: str, way: str, driving_side: str, standard: Standard
) -> Cycleway | None:
    value = tags.get(f"cycleway:{side}", tags.get("cycleway:both"))
    if value is None:
        value = _general(tags, side, way, driving_side)
    if value not in LANE | TRACK:
        return None
    width = next(
        (
            length
            for key in (f"cycleway:{side}:width", "cycleway:both:width", "cycleway:width")
            if (length := metres(tags.get(key))) is not None
        ),
        None,
    )
    advisory = "advisory" in (
        tags.get(f"cycleway:{side}:lane"),
        tags.get("cycleway:both:lane"),
        tags.get("cycleway:lane"),
    )
    track = value in TRACK
    default_m = standard.cycle_track if track else standard.cycle_lane
    if advisory and not track:
        default_m = standard.advisory_lane
    return Cycleway(min(max(width or default_m, 0.8), 5.0), track)


def _general(tags: Mapping[str, str], side: str, way: str, driving_side: str) -> str | None:
    """Return the value for a side that tags without a side imply."""
    value = tags.get("cycleway")
    sided = any(f"cycleway:{s}" in tags for s in ("left", "right", "both"))
    if value is None and not sided and tags.get("bicycle") == "use_sidepath":
        value = "track"
    outer = (side == driving_side) == (way != "backward")
    if value is None or way == "both":
        return value
    opposite = value.startswith("opposite")
    return value if outer != opposite else None


def _is_contraflow(tags: Mapping[str, str], side: str) -> bool:
    """Whether cyclists at the inner side of a one-way road ride against its traffic."""
    direction_tag = tags.get(f"cycleway:{side}:oneway", tags.get("cycleway:both:oneway"))
    if direction_tag is not None:
        return direction_tag in ("-1", "no", "reverse")
    values = (tags.get("cycleway"), tags.get(f"cycleway:{side}"))
    return tags.get("oneway:bicycle") in ("no", "-1") or any(
        value is not None and value.startswith("opposite") for value in values
    )
