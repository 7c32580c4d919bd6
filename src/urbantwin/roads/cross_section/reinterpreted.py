"""Tags of lanes and directions that a cross section takes otherwise than they say."""

from __future__ import annotations

from collections.abc import Mapping

from urbantwin.roads.cross_section.direction import one_way
from urbantwin.roads.cross_section.lane_tags import count, lane_list
from urbantwin.roads.cross_section.section import CrossSection

__all__ = ["reinterpreted"]

#: Values of ``oneway`` that are read as they are meant.
_KNOWN = frozenset({"yes", "true", "1", "-1", "reverse", "no", "false", "0"})


def reinterpreted(tags: Mapping[str, str], section: CrossSection) -> list[str]:
    """Return what of a way's tags its cross section leaves out or takes otherwise, each in words.

    Args:
        tags: the way's tags.
        section: what was made of them.
    """
    return [*_direction(tags, section), *_counts(tags), *_lists(tags, section)]


def _direction(tags: Mapping[str, str], section: CrossSection) -> list[str]:
    found = []
    oneway = tags.get("oneway", "no")
    if oneway == "reversible":
        found.append("oneway=reversible: traffic runs as the way is drawn")
    elif oneway == "alternating" and not section.one_lane:
        found.append("oneway=alternating: each direction has its lane, and nobody waits")
    elif oneway not in (*_KNOWN, "alternating"):
        found.append(f"oneway={oneway:.20}: taken for no")
    if any(lane.both_ways for lane in section.forward):
        found.append("a lane for both directions: a turning lane of the way's own direction")
    way = one_way(tags)
    against = section.lanes(forward=way == "backward")
    if way == "both" or any("bicycle" in lane.allowed for lane in against):
        return found
    opposite = {key: value for key, value in tags.items() if key.startswith("cycleway")}
    told = [f"{key}={value}" for key, value in opposite.items() if value.startswith("opposite")]
    if tags.get("oneway:bicycle") in ("no", "-1"):
        told.insert(0, f"oneway:bicycle={tags['oneway:bicycle']}")
    if told:
        found.append(f"{told[0]:.40}: bicycles ride with the traffic only")
    return found


def _counts(tags: Mapping[str, str]) -> list[str]:
    """Return the total of lanes where the parts that are mapped make another one."""
    total = count(tags.get("lanes"))
    parts = [count(tags.get(f"lanes:{name}")) for name in ("forward", "backward")]
    known = [number for number in parts if number is not None]
    if total is None or not known:
        return []
    made = sum(known) + (count(tags.get("lanes:both_ways")) or 0)
    whole = len(known) == 2 or one_way(tags) != "both"
    if "turn:lanes:both_ways" in tags and "lanes:both_ways" not in tags:
        made += 1
    if made == total or (made < total and not whole):
        return []
    told = " and ".join(
        f"lanes:{name}={number}"
        for name, number in zip(("forward", "backward"), parts, strict=True)
        if number is not None
    )
    return [f"lanes={total}, but {told}: the parts are taken"]


def _lists(tags: Mapping[str, str], section: CrossSection) -> list[str]:
    """Return the lists of turns that have another number of values than there are lanes."""
    found = []
    way = one_way(tags)
    for direction in ("forward", "backward") if way == "both" else (way,):
        lanes = section.lanes(forward=direction == "forward")
        listed = [lane for lane in lanes if lane.listed]
        counts = {len(listed), sum(lane.kind != "bicycle" for lane in listed)}
        for suffix in (direction, "") if way != "both" else (direction,):
            values = lane_list(tags, "turn:lanes", suffix)
            if values is not None and len(values) not in counts:
                key = f"turn:lanes:{suffix}" if suffix else "turn:lanes"
                found.append(f"{key} of {len(values)} values for {len(listed)} lanes: not used")
    return found
