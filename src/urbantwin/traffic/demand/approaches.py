"""Use of a site's approaches, in the form that SUMO's process takes (``sumo/lane_use``)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from urbantwin.errors import InputError
from urbantwin.roads import RoadNetwork
from urbantwin.site.yaml_document import nearest

__all__ = ["approaches_of"]

_MOTORS = {"car", "van", "truck", "bus", "motorcycle"}


def approaches_of(told: Sequence[Mapping[str, Any]], roads: RoadNetwork) -> dict[str, Any]:
    """Return, by road, the headway of its queues and the shares of its lanes by the next road.

    Args:
        told: ``traffic.approaches`` of the site.
        roads: the lanes.

    Returns:
        By road: ``queue_headway_s``, or ``None``, and ``lanes``: next road -> index of a lane in
            SUMO -> share; the shares add up to 1.

    Raises:
        InputError: an unknown or repeated road, an unknown lane, or one that does not lead to the
            next road.
    """
    lanes_of = {road.id: road.lanes for road in roads.roads}
    by_road: dict[str, Any] = {}
    for number, entry in enumerate(told):
        place, road = f"traffic.approaches[{number}]", entry["approach"]
        if road not in lanes_of:
            raise InputError(
                f"there is no road {road!r:.60}",
                place=f"{place}.approach",
                expected=f"a road's id: {nearest(road, list(lanes_of))}",
            )
        if road in by_road:
            raise InputError(
                f"road {road!r:.60} is given twice", place=f"{place}.approach", expected="one row"
            )
        leads = {
            lane: {after.road for after in roads.lanes_beyond(roads.lane_by_id[lane])}
            for lane in lanes_of[road]
            if _MOTORS & {*roads.lane_by_id[lane].allowed}
        }
        turns: dict[str, dict[str, float]] = {}
        for row, use in enumerate(entry.get("lanes") or ()):
            where = f"{place}.lanes[{row}]"
            turn = _turn(use["turn"], leads, turns, f"{where}.turn")
            turns[turn] = _shares(use, leads, f"{where}.shares")
        by_road[road] = {"queue_headway_s": entry.get("queue_headway_s"), "lanes": turns}
    return by_road


def _turn(turn: str, leads: Mapping[str, set[str]], known: Mapping[str, object], place: str) -> str:
    """Return the next road; raise an error if no lane leads there."""
    next_roads = sorted(set().union(*leads.values()))
    if turn not in next_roads:
        raise InputError(
            f"no lane of the approach leads to road {turn!r:.60}",
            place=place,
            expected=f"one of {', '.join(next_roads) or 'none'}",
        )
    if turn in known:
        raise InputError(f"road {turn!r:.60} is given twice", place=place, expected="one row")
    return turn


def _shares(use: Mapping[str, Any], leads: Mapping[str, set[str]], place: str) -> dict[str, float]:
    """Return shares by index of a lane in SUMO, scaled to a sum of 1."""
    lanes_that_lead = sorted(lane for lane, follow in leads.items() if use["turn"] in follow)
    for lane in use["shares"]:
        if lane not in lanes_that_lead:
            raise InputError(
                f"{lane!r:.60} is no lane of the approach that leads to road {use['turn']!r:.60}",
                place=place,
                expected=f"some of {', '.join(lanes_that_lead)}",
            )
    whole = sum(use["shares"].values())
    return {lane.rpartition("_")[2]: share / whole for lane, share in use["shares"].items()}
