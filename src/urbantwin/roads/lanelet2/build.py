"""Streets and connecting roads from lanelets, with a new plan where a street fails."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import StageError
from urbantwin.roads.lanelet2.connecting_road import (
    ConnectingRoad,
    Gate,
    connecting_road_of,
    gates_of,
    routes,
)
from urbantwin.roads.lanelet2.group import Member, groups_of
from urbantwin.roads.lanelet2.lane_sections import Row
from urbantwin.roads.lanelet2.lanelet import Lanelet
from urbantwin.roads.lanelet2.plan import Chain, Plan, plan_streets
from urbantwin.roads.lanelet2.street import Street, StreetTooShort, street_of
from urbantwin.roads.lanelet2.topology import Topology

__all__ = ["BuiltRoads", "LaneAt", "build_streets_and_junctions"]

#: Minimum length of a lost part of a lane that is reported, metres.
LOST_M = 0.01
#: Maximum number of plans; real maps need fewer than ten.
MOST_PLANS = 400
#: Road id, index of the section, lane id.
LaneAt = tuple[int, int, int]
#: Lanelets of a chain and its cuts -> its street; ``None`` if it cannot be built.
Made = dict[tuple[object, ...], Street | None]


@dataclass(frozen=True)
class BuiltRoads:
    """All roads, not yet linked.

    Attributes:
        streets: the streets.
        connecting_roads: the connecting roads through junctions.
        topology: links between lanelets.
        plan: assignment of each group of lanelets.
        shortened: lanelets without a connecting road at an oblique end of their street: the part
            beyond that end is lost.
        stubs: dropped lanelets that make neither a street nor a connecting road, mostly within
            junctions cut off by the border of the map.
    """

    streets: tuple[Street, ...]
    connecting_roads: tuple[ConnectingRoad, ...]
    topology: Topology
    plan: Plan
    shortened: tuple[int, ...]
    stubs: frozenset[int]

    @cached_property
    def lanes(self) -> dict[int, tuple[LaneAt, ...]]:
        """Lanelet -> the lanes made from it."""
        lanes_of: dict[int, list[LaneAt]] = {}
        for street in self.streets:
            for number, (lanes, span) in enumerate(zip(street.lanes, street.spans, strict=True)):
                for track, identity in lanes.items():
                    for group in span:
                        lanelet = track.member(group).lanelet.id
                        lanes_of.setdefault(lanelet, []).append((street.road.id, number, identity))
        for connecting_road in self.connecting_roads:
            for lanelet in connecting_road.lanelets:
                lane = connecting_road.road.sections[0].lanes[0].id
                lanes_of.setdefault(lanelet, []).append((connecting_road.road.id, 0, lane))
        return {i: tuple(rows) for i, rows in lanes_of.items()}

    @cached_property
    def approaches(self) -> dict[int, tuple[tuple[int, int], ...]]:
        """Lanelet -> (street, lane) that leads to its end.

        For a lanelet within a junction that is the lane where the connecting roads over it begin.
        """
        lanes_to: dict[int, dict[tuple[int, int], None]] = {}
        for street in self.streets:
            for number, span in enumerate(street.spans):
                for track, identity in street.lanes[number].items():
                    for group in span:
                        lanelet = track.member(group).lanelet.id
                        lanes_to.setdefault(lanelet, {})[street.road.id, identity] = None
        for connecting_road in self.connecting_roads:
            for lanelet in connecting_road.lanelets:
                gate = connecting_road.start
                lanes_to.setdefault(lanelet, {})[gate.street.road.id, gate.lane] = None
        return {i: tuple(rows) for i, rows in lanes_to.items()}


def build_streets_and_junctions(
    lanelets: Mapping[int, Lanelet],
    side: str,
    attributes: Callable[[Member], Row],
    ways: Mapping[int, dict[str, str]],
) -> BuiltRoads:
    """Build all streets and connecting roads.

    Args:
        lanelets: the map.
        side: driving side, ``right`` or ``left``.
        attributes: function that returns the attributes of a lanelet along its road.
        ways: tags of the map's ways.

    Raises:
        StageError: no plan succeeds.
    """
    lanes = {i: n for i, n in lanelets.items() if n.kind not in ("", "crosswalk")}
    drives = {i: n for i, n in lanes.items() if n.drives}
    forced: frozenset[int] = frozenset()
    apart: frozenset[int] = frozenset()
    barred: frozenset[int] = frozenset()
    stubs: frozenset[int] = frozenset()
    cache: Made = {}
    # Each round permanently removes a lanelet from a group, from a kind of use or from the map.
    limit = min(4 * len(drives) + 1, MOST_PLANS)
    for _ in range(limit):
        groups = [g for g in groups_of(lanes, apart) if any(m.lanelet.drives for m in g.members)]
        topology = Topology(drives, groups)
        plan = plan_streets(topology, forced, barred)
        ending = _cut_without_continuation(topology, plan) - apart
        if ending:
            apart |= ending
            continue
        streets, failed = _streets(topology, plan, side, attributes, ways, cache)
        left_out: frozenset[int] = frozenset()
        for chain in failed:
            ids = frozenset(i for group in chain.groups for i in group.ids)
            if all(topology.is_through(k) for k in chain.numbers) and not ids & barred:
                forced |= ids
            elif not ids <= apart:
                apart |= ids
            else:
                left_out |= ids
        if not failed:
            paths = _paths(streets, topology, plan)
            missed = plan.inner - {i for _, path, _ in paths for i in path}
            if not missed:
                connecting_roads = _connecting_roads(
                    paths, len(streets), topology, side, attributes, ways
                )
                short = _shortened(streets, connecting_roads)
                return BuiltRoads(
                    tuple(streets), tuple(connecting_roads), topology, plan, short, stubs
                )
            # First those without predecessor or successor: the next ones may then be reached.
            before = {k for following in topology.successors.values() for k in following}
            ends = {i for i in missed if i not in before or not topology.successors[i]} or missed
            if ends <= barred & apart:
                left_out |= ends
            barred |= ends
            apart |= ends
        if left_out:
            stubs |= left_out
            lanes = {i: n for i, n in lanes.items() if i not in left_out}
            drives = {i: n for i, n in drives.items() if i not in left_out}
    raise StageError(
        f"the lanelets cannot be divided into streets and junctions: {limit} plans did not work out"
    )


def _cut_without_continuation(topology: Topology, plan: Plan) -> frozenset[int]:
    """Return lanelets without continuation beside others that are cut: they must not be cut too."""
    before = {k for following in topology.successors.values() for k in following}
    lanelet_ids = set()
    for chain in plan.chains:
        for group, cut, end in zip(
            (chain.groups[0], chain.groups[-1]), chain.cuts, (False, True), strict=True
        ):
            drives = [member for member in group.members if member.lanelet.drives]
            if not cut or len(drives) == 1:
                continue
            for member in drives:
                i = member.lanelet.id
                joined = topology.successors[i] if member.forward == end else i in before
                if not joined:
                    lanelet_ids.add(i)
    return frozenset(lanelet_ids)


def _streets(
    topology: Topology,
    plan: Plan,
    side: str,
    attributes: Callable[[Member], Row],
    ways: Mapping[int, dict[str, str]],
    made: Made,
) -> tuple[list[Street], list[Chain]]:
    """Return the streets, and the chains that make none; ``made`` caches both for the next plan."""

    def follows(a: int, b: int) -> bool:
        return b in topology.successors[a]

    streets: list[Street] = []
    failed: list[Chain] = []
    for number, chain in enumerate(plan.chains):
        rows = tuple(tuple((m.lanelet.id, m.forward) for m in g.members) for g in chain.groups)
        key = (rows, chain.cuts)
        if key not in made:
            try:
                made[key] = street_of(1 + number, chain, follows, side, attributes, ways)
            except StreetTooShort:
                made[key] = None
        street = made[key]
        if street is None:
            failed.append(chain)
        else:
            # Numbers of groups and roads depend on the plan.
            road = replace(street.road, id=1 + len(streets) + len(failed))
            streets.append(replace(street, road=road, chain=chain))
    return streets, failed


def _length(line: NDArray[np.float64]) -> float:
    return float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())


def _shortened(streets: list[Street], connecting_roads: list[ConnectingRoad]) -> tuple[int, ...]:
    used = {(g.street.road.id, g.end, g.lane) for p in connecting_roads for g in (p.start, p.end)}
    return tuple(
        sorted(
            gate.lanelet
            for street in streets
            for gate in gates_of(street)
            if (street.road.id, gate.end, gate.lane) not in used
            and max(_length(line) for line in (gate.left, gate.right)) > LOST_M
        )
    )


def _paths(
    streets: list[Street], topology: Topology, plan: Plan
) -> list[tuple[Gate, tuple[int, ...], Gate]]:
    """Return all movements through junctions: start, lanelets and end."""
    gates = [gate for street in streets for gate in gates_of(street)]
    exits: dict[int, Gate] = {gate.lanelet: gate for gate in gates if not gate.inward}
    return [
        (gate, path, exits[last])
        for gate in gates
        if gate.inward
        for path, last in routes(gate.lanelet, topology.successors, plan.inner)
        if last in exits
    ]


def _connecting_roads(
    paths: list[tuple[Gate, tuple[int, ...], Gate]],
    streets: int,
    topology: Topology,
    side: str,
    attributes: Callable[[Member], Row],
    ways: Mapping[int, dict[str, str]],
) -> list[ConnectingRoad]:
    connecting_roads: list[ConnectingRoad] = []
    for start, path, end in paths:
        members = [Member(topology.lanelets[i], forward=True) for i in path]
        number = 1 + streets + len(connecting_roads)
        connecting_roads.append(
            connecting_road_of(number, start, members, end, side, attributes, ways)
        )
    return connecting_roads
