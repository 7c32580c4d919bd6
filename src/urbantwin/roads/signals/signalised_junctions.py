"""Signalised junctions of the map.

Mappers put ``highway=traffic_signals`` on the junction's own node, or at each stop line, up to tens
of metres before the junction (OSM wiki, "Tag:highway=traffic_signals"). netconvert signalises
nodes, so each signal is traced along its street to the node where streets meet.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from urbantwin.geometry import SiteFrame
from urbantwin.roads.sidewalk import WALKED
from urbantwin.site.extract import Extract, Way

__all__ = ["MappedSignals", "mapped_signals"]

#: Maximum distance of a signal and of a signalised crossing from its junction along the street,
#: metres.
SIGNAL_M = 40.0
CROSSING_M = 20.0
#: Minimum distance of a signalised mid-block crossing from junctions and from the streets' ends,
#: metres: netconvert joins nearer ones.
ALONE_M = 30.0
#: Streets that meet within this distance of each other form one junction, metres.
WITHIN_M = 28.0
ONE_WAY = {"yes": 1, "1": 1, "true": 1, "-1": -1, "reverse": -1}
SIGNALISED = {("highway", "traffic_signals"), ("crossing", "traffic_signals")}


@dataclass(frozen=True)
class MappedSignals:
    """The signalised junctions and crossings for netconvert.

    Attributes:
        tags: node -> tags that replace its own.
        junctions: nodes that get signals.
        inferred: those that get them because of signals or crossings on their arms.
        mid_block: signalised mid-block crossings, with their own signals.
        left_out: signalised crossings too close to a junction without signals.
    """

    tags: dict[int, dict[str, str]]
    junctions: tuple[int, ...]
    inferred: tuple[int, ...]
    mid_block: tuple[int, ...]
    left_out: tuple[int, ...]


@dataclass(frozen=True)
class _Leg:
    """A step along a street: next node, metres, whether along the way, whether open."""

    to: int
    length: float
    forward: bool
    open: bool


Legs = Mapping[int, list[_Leg]]


def mapped_signals(extract: Extract, ways: Iterable[Way], frame: SiteFrame) -> MappedSignals:
    """Return the junctions and crossings that mapped signals belong to.

    A node where streets meet gets signals in one of three cases. It has them itself. Or an arm has
    a signal (by ``traffic_signals:direction``) without a crossing between that could explain the
    signal alone. Or signals, or at least two signalised crossings, lie on half of its incoming
    arms.

    Args:
        extract: the map.
        ways: the ways that become roads.
        frame: the site frame.
    """
    legs = _legs(extract, ways, frame)
    meeting = {node for node, node_legs in legs.items() if len({leg.to for leg in node_legs}) >= 3}
    walked = {
        node
        for osm_way in extract.highways()
        if osm_way.tags["highway"] in WALKED
        for node in osm_way.nodes
        if node in legs
    }
    # ``crossing=no`` occurs at stop lines beside crossings.
    crossings = walked | {
        n for n in legs if extract.node_tags.get(n, {}).get("crossing", "no") != "no"
    }
    with_signal: set[int] = set()
    bare: set[int] = set()  # junctions with a signal on an arm, no crossing between
    arms: dict[int, set[int]] = defaultdict(set)  # junction -> arms with a signal
    crossed_arms: dict[int, set[int]] = defaultdict(set)  # junction -> arms with a signal crossing
    ends: dict[int, set[int]] = {}  # signal or crossing -> junctions that it may belong to
    for node in sorted(legs):
        tags = extract.node_tags.get(node, {})
        signal = tags.get("highway") == "traffic_signals"
        if not signal and tags.get("crossing") != "traffic_signals":
            continue
        ends[node] = set()
        if node in meeting:
            with_signal.add(node)
            ends[node].add(node)
            continue
        direction = tags.get("traffic_signals:direction", "")
        for junction, arm, crossed in _junctions_reached(
            node, legs, meeting, crossings, direction, signal=signal
        ):
            ends[node].add(junction)
            (arms if signal else crossed_arms)[junction].add(arm)
            if signal and not crossed:
                bare.add(junction)
    on = with_signal | bare
    for node in sorted({*arms, *crossed_arms} - on):
        marked_arms = len(arms[node] | crossed_arms[node])
        if 2 * marked_arms >= _entries(node, legs, meeting) and (arms[node] or marked_arms > 1):
            on.add(node)
    tags_of_node = {node: _cleared(extract.node_tags[node]) for node in ends}
    for node in on:
        cleared = _cleared(extract.node_tags.get(node, {}))
        tags_of_node[node] = {**cleared, "highway": "traffic_signals"}
    alone = [node for node, junctions in ends.items() if not on & junctions]
    mid_block = [node for node in alone if node in crossings and _is_mid_block(node, legs, meeting)]
    for node in mid_block:
        tags_of_node[node]["highway"] = "traffic_signals"
    left_out = [node for node in alone if node not in mid_block and node in crossings]
    return MappedSignals(
        tags_of_node,
        tuple(sorted(on)),
        tuple(sorted(on - with_signal)),
        tuple(mid_block),
        tuple(left_out),
    )


def _is_mid_block(node: int, legs: Legs, meeting: set[int]) -> bool:
    """Return whether a street continues from a node both ways without a junction close by."""
    if len(legs[node]) != 2:
        return False
    for leg in legs[node]:
        travelled_m, before, current = leg.length, node, leg.to
        while travelled_m <= ALONE_M:
            onward = [other for other in legs[current] if other.to != before]
            if current in meeting or len(onward) != 1:
                return False
            travelled_m, before, current = travelled_m + onward[0].length, current, onward[0].to
    return True


def _cleared(tags: Mapping[str, str]) -> dict[str, str]:
    """Return a node's tags without those from which netconvert makes a signal."""
    return {key: value for key, value in tags.items() if (key, value) not in SIGNALISED}


def _legs(extract: Extract, ways: Iterable[Way], frame: SiteFrame) -> Legs:
    legs: dict[int, list[_Leg]] = defaultdict(list)
    for osm_way in ways:
        nodes = [node for node in osm_way.nodes if node in extract.nodes]
        xy = frame.site_from_lonlat([extract.nodes[node] for node in nodes])
        steps = np.linalg.norm(np.diff(xy, axis=0), axis=1)
        ring = osm_way.tags.get("junction") in ("roundabout", "circular")
        one_way = ONE_WAY.get(osm_way.tags.get("oneway", ""), 1 if ring else 0)
        for (a, b), step in zip(pairwise(nodes), steps, strict=True):
            legs[a].append(_Leg(b, float(step), True, one_way >= 0))
            legs[b].append(_Leg(a, float(step), False, one_way <= 0))
    return dict(legs)


def _junctions_reached(
    node: int, legs: Legs, meeting: set[int], crossings: set[int], wanted: str, *, signal: bool
) -> list[tuple[int, int, bool]]:
    """Return junction, last node before it, and whether a crossing lies between.

    A signal belongs to the junction ahead of its traffic; a signalised crossing may also lie on a
    junction's exit. Between two junctions, the nearer one counts.
    """
    reached: list[tuple[float, int, int, bool]] = []
    forward = [leg.forward for leg in legs[node]]
    is_directed = signal and wanted in ("forward", "backward") and sorted(forward) == [False, True]
    for leg in legs[node]:
        if signal and (not leg.open or (is_directed and leg.forward != (wanted == "forward"))):
            continue
        travelled_m, before, current = leg.length, node, leg.to
        crossing = travelled_m if node in crossings else 0.0
        while travelled_m <= SIGNAL_M and current not in meeting:
            onward = [other for other in legs[current] if other.to != before]
            if len(onward) != 1:
                break
            if current in crossings or crossing:
                crossing += onward[0].length
            travelled_m, before, current = travelled_m + onward[0].length, current, onward[0].to
        if (
            current in meeting
            and travelled_m <= (SIGNAL_M if signal else CROSSING_M)
            and crossing <= CROSSING_M
        ):
            reached.append((travelled_m, current, before, crossing > 0))
    if signal and wanted == "both":
        return [item[1:] for item in reached]
    return [item[1:] for item in sorted(reached)[:1]]


def _entries(node: int, legs: Legs, meeting: set[int]) -> int:
    """Return the number of arms with traffic into a junction from outside, at least 1."""
    count = 0
    for leg in legs[node]:
        travelled_m, before, current = leg.length, node, leg.to
        while travelled_m <= WITHIN_M and current not in meeting:
            onward = [other for other in legs[current] if other.to != before]
            if len(onward) != 1:
                break
            travelled_m, before, current = travelled_m + onward[0].length, current, onward[0].to
        within = current in meeting and travelled_m <= WITHIN_M
        back = next(other for other in legs[leg.to] if other.to == node)
        count += back.open and not within
    return max(count, 1)
