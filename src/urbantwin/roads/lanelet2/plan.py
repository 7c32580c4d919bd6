"""Division of lanelets into streets and connecting roads of junctions.

A group of lanelets is a street unless lanes branch, merge or cross on it. At a fork, the part of a
group that overlaps its siblings is cut off and becomes a connecting road; the rest is a street.
Groups without a rest, and those crossed by others, lie entirely within the junction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from urbantwin.roads.lanelet2.group import Group
from urbantwin.roads.lanelet2.topology import End, Topology

__all__ = ["Chain", "Plan", "plan_streets"]

#: Minimum length of a connecting road cut off a street, metres.
LEAST_CUT_M = 5.0
#: Minimum length of a remaining street between two junctions, metres.
LEAST_STREET_M = 10.0
#: Minimum remaining length of other cut streets, metres, less if they are short.
KEPT_M = 5.0
#: Distance from the start of a connecting road to its first crossing, metres.
CLEAR_M = 3.0
#: Longer groups stay streets even if others cross them, metres.
LONGEST_INNER_M = 120.0


@dataclass(frozen=True)
class Chain:
    """Consecutive groups that form one street.

    Attributes:
        groups: the groups, all in the same direction.
        numbers: their indices in the topology.
        cuts: lengths cut off for the junctions at both ends, metres; ``None`` at free ends.
    """

    groups: tuple[Group, ...]
    numbers: tuple[int, ...]
    cuts: tuple[float | None, float | None]


@dataclass(frozen=True)
class Plan:
    """Streets, the lanelets within junctions, and crossing pairs outside junctions."""

    chains: tuple[Chain, ...]
    inner: frozenset[int]
    crossed: tuple[tuple[int, int], ...]


def plan_streets(topology: Topology, forced: frozenset[int], barred: frozenset[int]) -> Plan:
    """Divide groups into streets and lanelets within junctions.

    Args:
        topology: links between lanelets.
        forced: lanelets that are too short for a street of their own.
        barred: lanelets without a connecting road over them, which must be streets.
    """
    inner = {
        k
        for k in _crossed_or_tagged(topology, forced)
        if not barred.intersection(topology.groups[k].ids)
    }
    while True:
        cuts = _cuts(topology, inner)
        newly_inner = set()
        for k, group in enumerate(topology.groups):
            end_cuts = [cuts.get((k, e)) for e in (0, 1)]
            cut_m = sum(cut or 0.0 for cut in end_cuts)
            if k in inner or not cut_m:
                continue
            short = group.length - cut_m < (LEAST_STREET_M if all(end_cuts) else 1.0)
            if short and topology.is_through(k) and not barred.intersection(group.ids):
                newly_inner.add(k)
            elif cut_m > (most_m := group.length - min(KEPT_M, 0.4 * group.length)):
                for e in (0, 1):
                    if (k, e) in cuts:
                        cuts[k, e] *= most_m / cut_m
        if not newly_inner:
            break
        inner |= newly_inner
    lanelets = frozenset(i for k in inner for i in topology.groups[k].ids)
    outside = tuple(
        (a, b)
        for (a, s), (b, t) in topology.crossing
        if not all(_is_cut(topology, lanelets, cuts, *place) for place in ((a, s), (b, t)))
    )
    return Plan(_chains(topology, inner, cuts), lanelets, outside)


def _crossed_or_tagged(topology: Topology, forced: frozenset[int]) -> set[int]:
    crossed = {i for pair in topology.crossing for i, _ in pair}
    inner = set()
    for k, group in enumerate(topology.groups):
        if not topology.is_through(k):
            continue
        ids = set(group.ids)
        within = {m.lanelet.within for m in group.members if m.lanelet.drives}
        turns = True in within or (None in within and ids & crossed)
        if ids & forced or (turns and group.length <= LONGEST_INNER_M):
            inner.add(k)
    return inner


def _cuts(topology: Topology, inner: set[int]) -> dict[End, float]:
    """Return lengths to cut off groups that meet without a connecting road between them, metres."""
    chosen: dict[End, float] = dict.fromkeys(_rings(topology), LEAST_CUT_M)
    links = sorted({(e, f) for e, f, _, _ in topology.links})
    for e, f in links:
        if e[0] in inner or f[0] in inner or e in chosen or f in chosen:
            continue
        if topology.is_plain(e) and _joins(topology, e, f):
            continue
        # The end with more partners stays; of equals, the first one.
        cut = f if len(topology.partners[e]) >= len(topology.partners[f]) else e
        chosen[cut] = max(LEAST_CUT_M, topology.overlap(cut) + 1.0, _crossed_from(topology, cut))
    return chosen


def _crossed_from(topology: Topology, end: End) -> float:
    """Return the distance of the last crossing from an end of a group that leads nowhere."""
    group = topology.groups[end[0]]
    if topology.is_through(end[0]) or group.length > LONGEST_INNER_M:
        return 0.0
    distances = [
        _from_end(topology, end, *place)
        for pair in topology.crossing
        for place in pair
        if topology.place[place[0]][0] == end[0]
    ]
    return max(distances, default=-CLEAR_M) + CLEAR_M


def _from_end(topology: Topology, end: End, lanelet: int, along: float) -> float:
    """Return the distance from an end of a group to a place along one of its lanelets, metres."""
    from_start = topology.place[lanelet][1] == (end[1] == 0)
    return along if from_start else topology.lanelets[lanelet].centre.length - along


def _is_cut(
    topology: Topology,
    inner: frozenset[int],
    cuts: dict[End, float],
    lanelet: int,
    along: float,
) -> bool:
    """Return whether a place lies on a connecting road."""
    k = topology.place[lanelet][0]
    return lanelet in inner or any(
        _from_end(topology, (k, e), lanelet, along) < cuts.get((k, e), 0.0) for e in (0, 1)
    )


def _rings(topology: Topology) -> list[End]:
    """Return two ends at which each ring of groups without entry is cut open."""
    seen: set[int] = set()
    ends = []
    for k in range(len(topology.groups)):
        entered: list[End] = []
        end: End = (k, 1)
        while k not in seen and topology.is_plain(end):
            other = next(iter(topology.partners[end]))
            entered.append(other)
            end = (other[0], 1 - other[1])
            if other[0] == k:
                ends += [entered[-1], entered[(len(entered) - 1) // 2]]
            if other[0] in seen or other[0] == k:
                break
            seen.add(other[0])
        seen.add(k)
    return ends


def _joins(topology: Topology, e: End, f: End) -> bool:
    """Return whether the lanes of two ends continue into each other in the same order."""
    pairs = {}
    for a, b, from_id, to_id in topology.links:
        if {a, b} == {e, f}:
            first, second = (from_id, to_id) if a == e else (to_id, from_id)
            if first in pairs:
                return False
            pairs[first] = second
    seen = [pairs[i] for i in topology.groups[e[0]].ids if i in pairs]
    order = topology.groups[f[0]].ids
    places = [order.index(i) for i in seen]
    if e[1] == f[1]:
        places = places[::-1]
    return places == sorted(set(places)) and bool(places)


def _chains(topology: Topology, inner: set[int], cuts: dict[End, float]) -> tuple[Chain, ...]:
    seen: set[int] = set()
    chains = []

    def following(end: End) -> End | None:
        if not topology.is_plain(end):
            return None
        other = next(iter(topology.partners[end]))
        free = other[0] not in inner and end not in cuts and other not in cuts
        return other if free else None

    for k in range(len(topology.groups)):
        if k in inner or k in seen:
            continue
        row: list[tuple[int, bool]] = [(k, True)]
        seen.add(k)
        for end in (1, 0):
            # First forwards, then backwards from the start.
            tip: End = (k, end)
            while (other := following(tip)) is not None and other[0] not in seen:
                seen.add(other[0])
                same_direction = (other[1] == 0) == (end == 1)
                row.insert(len(row) if end else 0, (other[0], same_direction))
                tip = (other[0], 1 - other[1])
        ends = [
            (row[0][0], 0 if row[0][1] else 1),
            (row[-1][0], 1 if row[-1][1] else 0),
        ]
        chains.append(
            Chain(
                tuple(
                    _oriented(topology.groups, number, same_direction)
                    for number, same_direction in row
                ),
                tuple(number for number, _ in row),
                (
                    cuts.get(ends[0], 0.0) if topology.partners.get(ends[0]) else None,
                    cuts.get(ends[1], 0.0) if topology.partners.get(ends[1]) else None,
                ),
            )
        )
    return tuple(chains)


def _oriented(groups: Sequence[Group], number: int, same: bool) -> Group:
    return groups[number] if same else groups[number].flipped
