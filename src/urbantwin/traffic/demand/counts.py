"""Counted traffic: trips that pass the junction as it was counted, by approach and turn.

A row of counts is a way through: it begins at the region's border where its approach is reached
soonest, goes over the approach and the exit, and ends where the border is soonest reached again.
Two roads that are not neighbours make a row of a table of origins and destinations.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse.csgraph
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.roads import Road, RoadNetwork
from urbantwin.roads.assignment.street_network import StreetNetwork, Streets
from urbantwin.traffic.demand.demand import Demand, LeftOut, Trip
from urbantwin.traffic.demand.vehicle_types import ACTOR_KINDS
from urbantwin.traffic.sumo.simulation import Simulated

__all__ = ["counted_demand", "counted_report", "is_counted", "main_junction", "turn_of"]

_ARMS = ("east", "north-east", "north", "north-west", "west", "south-west", "south", "south-east")
_TURNS = ("left", "through", "right", "u-turn")
_NOT_MOTORS = ("bicycle", "pedestrian", "tram")
_QUARTER_S = 900.0
#: A change of direction of less is through, of more a u-turn, degrees.
_THROUGH_DEG, _BACK_DEG = 35.0, 150.0
_DIRECTION_M = 20.0  # over so much of a road its direction is taken
_MOST_OF_A_ROW = 100_000  # bodies of a row are drawn by numbers of its own
_STREAM = 1000  # of random numbers, after those of the classes


@dataclass(frozen=True)
class _Way:
    """A row of counts in terms of roads."""

    approach: Road
    exit: Road


def counted_demand(
    counts: Sequence[Mapping[str, Any]],
    roads: RoadNetwork,
    network: StreetNetwork,
    per_hour: Mapping[str, float],
    *,
    warmup_s: float,
    duration_s: float,
    seed: int,
    body: Callable[[str, int], str],
) -> Demand:
    """Return the trips that counts ask for, row by row; each row has random numbers of its own.

    Args:
        counts: ``traffic.counts`` of the site.
        roads: the lane network, which knows names and places of roads.
        network: its streets, without outer roads.
        per_hour: by which motor traffic without a class is shared out.
        warmup_s: how long traffic runs before the motion starts.
        duration_s: how long the motion is.
        seed: the same seed gives the same trips.
        body: the asset of the n-th actor of a class.

    Raises:
        InputError: an approach or a turn is not there; the row is named.
    """
    trips: list[tuple[Trip, int]] = []
    left_out: list[LeftOut] = []
    streets: dict[str, Streets | None] = {}
    owed: dict[str, float] = {}
    exits: list[str] = []
    for number, row in enumerate(counts):
        place = row.get("row") or f"traffic.counts[{number}]"
        way = _way(row, roads, place)
        exits.append(way.exit.id)
        for name, rates in _rates(row, per_hour, place).items():
            vclass = ACTOR_KINDS[name].vclass
            if vclass not in streets:
                streets[vclass] = network.driven_by(vclass)
            found = streets[vclass]
            edges = None if found is None else _edges(found, way)
            random = np.random.Generator(np.random.Philox(key=[seed, _STREAM + number]))
            wanted = _wanted(rates, warmup_s, duration_s)
            at = _departures(wanted, owed.get(name, 0.5), random)
            owed[name] = (owed.get(name, 0.5) + sum(count for _, _, count in wanted)) % 1.0
            if edges is None:
                if len(at):
                    why = f"no way from {way.approach.id} to {way.exit.id} for it ({place})"
                    left_out.append(LeftOut(name, len(at), why))
                continue
            trips += [
                (
                    Trip(
                        name,
                        body(name, number * _MOST_OF_A_ROW + k),
                        round(float(time_s), 2),
                        edges,
                    ),
                    number,
                )
                for k, time_s in enumerate(at)
            ]
    trips.sort(key=lambda one: (one[0].depart_s, one[1]))
    rows: list[list[int]] = [[] for _ in counts]
    for number, (_, row_number) in enumerate(trips):
        rows[row_number].append(number)
    counted = tuple((leaving, tuple(row)) for leaving, row in zip(exits, rows, strict=True))
    return Demand(tuple(trip for trip, _ in trips), tuple(left_out), counted=counted)


def counted_report(
    counts: Sequence[Mapping[str, Any]],
    per_hour: Mapping[str, float],
    demand: Demand,
    simulated: Simulated,
    *,
    steps: int,
    step_s: float,
) -> list[dict[str, Any]]:
    """Return what was asked and what was driven, row by row, vehicles an hour.

    Driven are those who came onto the exit while the motion lasted.

    Args:
        counts: ``traffic.counts`` of the site.
        per_hour: by which motor traffic without a class is shared out.
        demand: the trips.
        simulated: what SUMO saw of them.
        steps: how many steps the motion has.
        step_s: time between them.
    """
    duration_s = steps * step_s
    edge_of_lane = np.array([lane.rpartition("_")[0] for lane in simulated.lanes], object)
    told = []
    for row, (leaving, trips) in zip(counts, demand.counted, strict=True):
        rates = _rates(row, per_hour, "").values()
        asked = sum(count for one in rates for _, _, count in _wanted(one, 0.0, duration_s))
        lanes = np.flatnonzero(edge_of_lane == leaving)
        there = np.isin(simulated.lane, lanes) & np.isin(simulated.trip, trips)
        # Of each trip the first step on the exit; those of before the motion were there already.
        order = np.lexsort([simulated.step[there], simulated.trip[there]])
        _, first = np.unique(simulated.trip[there][order], return_index=True)
        came = simulated.step[there][order][first]
        told.append(
            {
                "approach": row["approach"],
                "turn": row["turn"],
                "class": row.get("actor_class") or "motor traffic",
                "has_way": bool(trips) or asked < 1,
                "asked_per_hour": round(asked * 3600 / duration_s, 1),
                "driven_per_hour": round(
                    int(((came >= 0) & (came < steps)).sum()) * 3600 / duration_s, 1
                ),
            }
        )
    return told


def is_counted(actor_class: str, counts: Sequence[Mapping[str, Any]]) -> bool:
    """Return whether counts say how many of a class come."""
    named = {row.get("actor_class") for row in counts}
    return actor_class in named or (None in named and actor_class not in _NOT_MOTORS)


def turn_of(roads: RoadNetwork, approach: Road, leaving: Road) -> str:
    """Return how one turns from one road into another: left, through, right or u-turn."""
    into = _direction(roads, approach, at_end=True)
    away = _direction(roads, leaving, at_end=False)
    turned = float(np.degrees(np.angle(np.exp(1j * (away - into)))))
    if abs(turned) < _THROUGH_DEG:
        return "through"
    if abs(turned) > _BACK_DEG:
        return "u-turn"
    return "left" if turned > 0 else "right"


def _rates(
    row: Mapping[str, Any], per_hour: Mapping[str, float], place: str
) -> dict[str, list[float]]:
    """Return by class the vehicles an hour in each quarter; a single value holds all the time."""
    if row.get("per_quarter"):
        rates = [4.0 * float(count) for count in row["per_quarter"]]
    else:
        rates = [float(row["per_hour"])]
    if row.get("actor_class"):
        if row["actor_class"] == "pedestrian":
            raise InputError(
                "counts pedestrians", place=place, expected="those who drive; per_hour for walkers"
            )
        return {row["actor_class"]: rates}
    motors = {name: rate for name, rate in per_hour.items() if name not in _NOT_MOTORS and rate > 0}
    motors = motors or {"car": 1.0}
    whole = sum(motors.values())
    return {name: [rate * share / whole for rate in rates] for name, share in motors.items()}


def _wanted(
    rates: Sequence[float], warmup_s: float, duration_s: float
) -> list[tuple[float, float, float]]:
    """Return (from, to, how many): from the start of the warm-up on, seconds."""
    found, end = [], warmup_s + duration_s
    begin = 0.0
    for number, rate in enumerate(rates):
        last = number == len(rates) - 1
        until = end if last else min(warmup_s + (number + 1) * _QUARTER_S, end)
        if until > begin:
            found.append((begin, until, rate * (until - begin) / 3600.0))
            begin = until
    return found


def _departures(
    wanted: Sequence[tuple[float, float, float]], owed: float, random: np.random.Generator
) -> NDArray[np.float64]:
    """Return when they set out, one at random in each of as many equal parts as there are of them.

    Args:
        wanted: (from, to, how many).
        owed: what rows before have left of a vehicle, so that shares of vehicles add up.
        random: random numbers.
    """
    times = []
    for begin, end, count in wanted:
        whole = int(np.floor(owed + count))
        owed = owed + count - whole
        times.append(
            begin + (np.arange(whole) + random.random(whole)) * (end - begin) / max(whole, 1)
        )
    return np.concatenate(times) if times else np.zeros(0)


def _edges(streets: Streets, way: _Way) -> tuple[str, ...] | None:
    """Return the edges of a way from border to border; ``None`` where there is none."""
    number = {name: k for k, name in enumerate(streets.edges)}
    start, end = number.get(way.approach.id), number.get(way.exit.id)
    if start is None or end is None:
        return None
    over = _path(streets.seconds, start, end) if start != end else [start]
    # What is soonest reached of all entries is found backwards.
    before = _nearest(streets.seconds.T.tocsr(), start, streets.entries.edge)
    after = _nearest(streets.seconds, end, streets.exits.edge)
    if over is None or before is None or after is None:
        return None
    whole = [*before[::-1], *over[1:], *after[1:]]
    return tuple(streets.edges[edge] for edge in whole)


def _path(graph: Any, start: int, end: int) -> list[int] | None:  # noqa: ANN401
    seconds, previous = scipy.sparse.csgraph.dijkstra(
        graph, indices=start, return_predecessors=True
    )
    if not np.isfinite(seconds[end]):
        return None
    path = [end]
    while path[-1] != start:
        path.append(int(previous[path[-1]]))
    return path[::-1]


def _nearest(graph: Any, start: int, ends: NDArray[np.int64]) -> list[int] | None:  # noqa: ANN401
    """Return the way from an edge to the end that is soonest reached."""
    seconds = scipy.sparse.csgraph.dijkstra(graph, indices=start)
    best = int(ends[np.argmin(seconds[ends])])
    return _path(graph, start, best) if np.isfinite(seconds[best]) else None


def _way(row: Mapping[str, Any], roads: RoadNetwork, place: str) -> _Way:
    """Return the roads that a row means.

    Raises:
        InputError: one is not there, or is not the only one.
    """
    by_id = {road.id: road for road in roads.roads}
    name, turn = str(row["approach"]), str(row["turn"])
    junction = main_junction(roads)
    approaches = [road for road in roads.roads if road.to_junction == junction]
    approach = by_id.get(name)
    if approach is None:
        approach = _one(name, approaches, roads, at_end=True, place=place, what="approach")
    exits = [road for road in roads.roads if road.from_junction == approach.to_junction]
    leaving = by_id.get(turn)
    if leaving is None and turn in _TURNS:
        turned = [road for road in exits if turn_of(roads, approach, road) == turn]
        if not turned:
            there = ", ".join(f"{road.id} ({turn_of(roads, approach, road)})" for road in exits)
            raise InputError(
                f"nobody can go {turn} from {name}", place=place, expected=f"one of {there}"
            )
        # Of several the one that is most so: nearest to a right angle, or straight on.
        leaving = min(turned, key=lambda road: _off(roads, approach, road, turn))
    if leaving is None:
        leaving = _one(turn, exits, roads, at_end=False, place=place, what="turn")
    return _Way(approach, leaving)


def _one(
    name: str, among: list[Road], roads: RoadNetwork, *, at_end: bool, place: str, what: str
) -> Road:
    """Return the road of a junction that a name or an arm means."""
    arms = {road.id: _arm(roads, road, at_end=at_end) for road in among}
    found = [road for road in among if name in (arms[road.id], road.name)]
    if len(found) == 1:
        return found[0]
    there = ", ".join(
        f"{road.id} ({arms[road.id]}{', ' + road.name if road.name else ''})" for road in among
    )
    problem = f"means {len(found)} roads" if found else "is not there"
    extra = f", or {', '.join(_TURNS)}" if what == "turn" else ""
    raise InputError(
        f"the {what} {name!r} {problem}", place=place, expected=f"one of {there}{extra}"
    )


def main_junction(roads: RoadNetwork) -> str:
    """Return the junction that is meant where none is named: most roads come to it, near x, y 0."""
    ways = {road.to_junction for road in roads.roads}
    count = {
        one.id: sum(len(road.lanes) for road in roads.roads if road.to_junction == one.id)
        for one in roads.junctions
        if one.id in ways
    }
    place = {one.id: one.polygon.centroid for one in roads.junctions if not one.polygon.is_empty}
    return max(
        sorted(count),
        key=lambda one: (
            count[one] - (np.hypot(place[one].x, place[one].y) / 50 if one in place else 9)
        ),
    )


def _direction(roads: RoadNetwork, road: Road, *, at_end: bool) -> float:
    """Return the direction of a road where it meets the junction, rad from east."""
    centre = roads.lane_by_id[road.lanes[-1]].centre[:, :2]
    away_from = centre[::-1] if at_end else centre
    near = away_from[0]
    beyond = np.linalg.norm(away_from - near, axis=1) >= _DIRECTION_M
    far = away_from[int(np.argmax(beyond)) if beyond.any() else -1]
    step = near - far if at_end else far - near
    return float(np.arctan2(step[1], step[0]))


def _arm(roads: RoadNetwork, road: Road, *, at_end: bool) -> str:
    """Return on which side of the junction a road lies."""
    bearing = _direction(roads, road, at_end=at_end) + (np.pi if at_end else 0.0)
    return _ARMS[round(float(np.degrees(bearing)) % 360 / 45) % 8]


def _off(roads: RoadNetwork, approach: Road, leaving: Road, turn: str) -> float:
    into = _direction(roads, approach, at_end=True)
    away = _direction(roads, leaving, at_end=False)
    turned = abs(float(np.degrees(np.angle(np.exp(1j * (away - into))))))
    return abs(turned - {"through": 0.0, "u-turn": 180.0}.get(turn, 90.0))
