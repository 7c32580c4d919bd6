"""Lanes that begin shortly before a stop line: what they hold, and the lanes that they begin from.

A lane that is shorter than its queue lets in no more than the lane that it begins from brings, and
who waits in that for another lane holds it up (HCM 2016, 31, turn bay overflow).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from lxml import etree

__all__ = ["Pocket", "pocket_lanes"]

#: Lanes longer than this hold the queue of a cycle, metres: of ten vehicles.
LONG_M = 75.0


@dataclass(frozen=True)
class Pocket:
    """A lane that begins shortly before the stop line.

    Attributes:
        length: of it, metres.
        before: the lanes that lead into it.
    """

    length: float
    before: tuple[str, ...]


def pocket_lanes(root: etree._Element, waiting: Iterable[str]) -> dict[str, Pocket]:
    """Return the pockets among some lanes: of streets that have fewer lanes just before.

    Args:
        root: the network.
        waiting: lanes that end at a stop line.
    """
    lanes = {lane.get("id"): lane for lane in root.iterfind("edge/lane")}
    into: dict[str, set[str]] = defaultdict(set)
    signalised: set[str] = set()
    for item in root.iter("connection"):
        if item.get("from").startswith(":") or item.get("dir") == "t":
            continue
        start, end = (f"{item.get(k)}_{item.get(k + 'Lane')}" for k in ("from", "to"))
        if start in lanes and end in lanes and _driven(lanes[start]) and _driven(lanes[end]):
            into[end].add(start)
        if item.get("tl"):
            signalised.add(start)
    roads: dict[str, list[str]] = defaultdict(list)
    for name in sorted(set(waiting)):
        if name in lanes and _driven(lanes[name]):
            roads[_road(name)].append(name)
    found: dict[str, Pocket] = {}
    for own in roads.values():
        found |= _pockets(own, lanes, into, signalised)
    return found


def _pockets(
    own: list[str],
    lanes: Mapping[str, etree._Element],
    into: Mapping[str, set[str]],
    signalised: set[str],
) -> dict[str, Pocket]:
    at = {name: name for name in own}
    length = 0.0
    while True:
        length += float(lanes[next(iter(at.values()))].get("length"))
        before = {name: into.get(lane, set()) for name, lane in at.items()}
        whole = set().union(*before.values())
        # Beyond another signal, or where streets meet, queues are not one.
        if length > LONG_M or len({_road(lane) for lane in whole}) != 1 or whole & signalised:
            return {}
        if len(whole) < len(at):
            return {
                name: Pocket(length, tuple(sorted(lanes or whole)))
                for name, lanes in before.items()
            }
        # As many lanes or more: each goes on in one of its own.
        left, onward = set(whole), {}
        for name in sorted(at, key=lambda name: (len(before[name]), name)):
            free = sorted(before[name] & left)
            if not free:
                return {}
            onward[name] = free[0]
            left.discard(free[0])
        at = onward


def _road(lane: str) -> str:
    return lane.rpartition("_")[0]


def _driven(lane: etree._Element) -> bool:
    allow, disallow = (lane.get(key, "").split() for key in ("allow", "disallow"))
    return "passenger" in allow if allow else not {"passenger", "all"} & set(disallow)
