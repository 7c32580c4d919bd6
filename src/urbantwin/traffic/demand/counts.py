"""Counted traffic: trips that reproduce counts by approach and turn.

The route of a row of counts begins at the border of the region from which its approach is reached
soonest. It leads over the approach and the exit, and ends where the border is reached soonest
again. Two roads that are not neighbours make a row of an origin-destination table. If a vehicle may
be counted in several rows, routes are fitted to all of them (`fitted_demand`).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import scipy.sparse.csgraph
from numpy.typing import NDArray

from urbantwin.roads import RoadNetwork
from urbantwin.roads.assignment.street_network import StreetNetwork, Streets
from urbantwin.taxonomy import ACTOR_CLASSES
from urbantwin.traffic.demand.count_rates import departures_of, rates_of, wanted_of
from urbantwin.traffic.demand.counted_places import crossing_of, ridden_along, road_of, way_of
from urbantwin.traffic.demand.demand import WALKING_MS, CountedRow, Demand, LeftOut, Routes, Trip
from urbantwin.traffic.demand.vehicle_types import ACTOR_KINDS

__all__ = ["counted_demand", "fitted_demand", "fitted_volumes", "way_through"]

#: Rounds of scaling volumes, after which sums of independent counts agree to a thousandth.
_ROUNDS = 400
_TINY = 1e-9
#: Routes with a lower volume per hour are dropped.
_MIN_ROUTE_VOLUME = 1e-3
#: Offsets of random streams: each route of a class has its own.
_STREAM, _CLASS_STREAM = 2_000_000, 100_000
_ASSETS_PER_ROUTE = 100_000
_PEDESTRIAN = "pedestrian"
_CROSSING = re.compile(r"_c\d+$")
#: Detour equivalent of the 20 s that SUMO's pedestrians accept to avoid a red light.
_DETOUR_M = 20.0 * WALKING_MS


@dataclass(frozen=True)
class _Place:
    """The place of a row of counts: two edges that are passed in this order, or a single one.

    ``turn`` tells whether they meet at a junction.
    """

    first: str
    last: str
    turn: bool = False

    def passed_by(self, edges: Sequence[str]) -> bool:
        """Return whether a route passes the place."""
        if self.first not in edges or self.last not in edges:
            return False
        last_index = len(edges) - 1 - edges[::-1].index(self.last)
        return edges.index(self.first) <= last_index


@dataclass(frozen=True)
class _Routes:
    """The routes of a class: edges, rows of counts that each passes, and relative volumes."""

    edges: list[tuple[str, ...]]
    passed: list[tuple[int, ...]]
    weight: NDArray[np.float64]
    routes: Routes | None


def fitted_demand(  # noqa: PLR0913 - all inputs of counts
    counts: Sequence[Mapping[str, Any]],
    roads: RoadNetwork,
    network: StreetNetwork,
    per_hour: Mapping[str, float],
    *,
    warmup_s: float,
    duration_s: float,
    seed: int,
    body: Callable[[str, int], str],
    evenly: bool = True,
) -> Demand:
    """Return the trips of the routes that agree best with all counts; see `counted_demand`.

    Raises:
        InputError: a place does not exist; the message names the row.
    """
    spots = [row.get("row") or f"traffic.counts[{number}]" for number, row in enumerate(counts)]
    places = [_place(row, roads, spot) for row, spot in zip(counts, spots, strict=True)]
    by_class: dict[str, dict[int, list[float]]] = {}
    for number, (row, spot) in enumerate(zip(counts, spots, strict=True)):
        for name, rates in rates_of(row, per_hour, spot).items():
            by_class.setdefault(name, {})[number] = rates
    trips: list[tuple[Trip, tuple[int, ...]]] = []
    left_out: list[LeftOut] = []
    nowhere: set[int] = set()  # rows of places that no route passes
    for kind, name in enumerate(ACTOR_CLASSES):
        if name not in by_class:
            continue
        rows = by_class[name]
        routes = _ways(name, {number: places[number] for number in rows}, network)
        for number in rows:
            expected = round(sum(n for _, _, n in wanted_of(rows[number], 0.0, duration_s)))
            if expected and not any(number in passed for passed in routes.passed):
                nowhere.add(number)
                why = f"no way for it where was counted ({spots[number]})"
                left_out.append(LeftOut(name, expected, why))
        owed = 0.5
        volumes = _volumes(name, routes, rows, per_hour)
        # Sorted so that fractions of vehicles add up among routes that pass the same places.
        for route in sorted(range(len(routes.edges)), key=lambda route: routes.passed[route]):
            if volumes[route].max() < _MIN_ROUTE_VOLUME:
                continue
            key = _STREAM + kind * _CLASS_STREAM + route
            random = np.random.Generator(np.random.Philox(key=[seed, key]))
            flow = wanted_of(volumes[route].tolist(), warmup_s, duration_s)
            departures_s = departures_of(flow, owed, random, evenly=evenly)
            owed = (owed + sum(count for _, _, count in flow)) % 1.0
            for k, time_s in enumerate(np.round(departures_s, 2).tolist()):
                body_class = body(name, route * _ASSETS_PER_ROUTE + k)
                trip = _trip(name, body_class, time_s, routes, route, warmup_s, random)
                trips.append((trip, routes.passed[route]))
    trips.sort(
        key=lambda numbered_trip: (
            numbered_trip[0].depart_s,
            numbered_trip[1],
            numbered_trip[0].edges,
        )
    )
    numbers: list[list[int]] = [[] for _ in counts]
    for number, (trip, passed_places) in enumerate(trips):
        # SUMO's pedestrians cross where it is shortest: any of them may be counted there.
        on_foot = trip.actor_class == _PEDESTRIAN
        for where in by_class[_PEDESTRIAN].keys() - nowhere if on_foot else passed_places:
            numbers[where].append(number)
    counted = (
        CountedRow(place.first, place.last, tuple(row))
        for place, row in zip(places, numbers, strict=True)
    )
    return Demand(tuple(trip for trip, _ in trips), tuple(left_out), counted=tuple(counted))


def fitted_volumes(
    usual: NDArray[np.float64], passes: NDArray[np.bool_], counted: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return volumes of routes (W,) that agree with the counts, near to the usual ones.

    Args:
        usual: (W,) usual volumes, relative or per hour.
        passes: (W, R) whether a route passes the place of a row.
        counted: (R,) actors per hour.
    """
    volumes = usual.astype(np.float64)
    if not passes.any():
        return volumes
    volumes[passes[:, counted <= 0].any(axis=1)] = 0.0
    most = int(passes.sum(axis=1).max())
    touched = passes.any(axis=1)
    whole = volumes[touched].sum()
    if whole > 0:  # initial scale
        volumes[touched] *= counted.sum() / whole
    for _ in range(_ROUNDS):
        fitted_counts = volumes @ passes
        ratio = np.where(
            (fitted_counts > _TINY) & (counted > 0),
            counted / np.maximum(fitted_counts, _TINY),
            1,
        )
        volumes[touched] *= np.exp(passes[touched] @ np.log(ratio) / most)
    return volumes


def _place(row: Mapping[str, Any], roads: RoadNetwork, spot: str) -> _Place:
    if row.get("crossing") and row.get("actor_class") == "bicycle":
        movement = ridden_along(row, roads, spot)
        return _Place(movement.approach.id, movement.exit.id)
    if row.get("crossing"):
        edge = crossing_of(row, roads, spot).id.rpartition("_")[0]
        return _Place(edge, edge)
    if row.get("road"):
        road = road_of(str(row["road"]), roads, spot).id
        return _Place(road, road)
    movement = way_of(row, roads, spot)
    turn = movement.approach.to_junction == movement.exit.from_junction
    return _Place(movement.approach.id, movement.exit.id, turn=turn)


def _volumes(
    name: str, ways: _Routes, rows: Mapping[int, Sequence[float]], per_hour: Mapping[str, float]
) -> NDArray[np.float64]:
    """Return the volumes of routes by quarter of an hour (W, Q), actors per hour.

    Args:
        name: the class.
        ways: its routes.
        rows: number of a row of counts -> actors per hour, quarter by quarter.
        per_hour: pedestrians per hour where there are no counts.
    """
    passes = np.array([[number in passed for number in rows] for passed in ways.passed], bool)
    passes = passes.reshape(len(ways.edges), len(rows))
    usual = ways.weight.copy()
    if name == _PEDESTRIAN:  # pedestrians that pass no counted place keep their usual volume
        usual *= per_hour.get(name, 0.0) / max(usual.sum(), _TINY)
    else:
        usual[~passes.any(axis=1)] = 0.0
    quarters = max(len(rates) for rates in rows.values())
    wanted = [[rates[min(k, len(rates) - 1)] for rates in rows.values()] for k in range(quarters)]
    return np.array([fitted_volumes(usual, passes, np.array(counted)) for counted in wanted]).T


def _ways(name: str, places: Mapping[int, _Place], network: StreetNetwork) -> _Routes:
    """Return the routes from gate to gate, plus one for each place that none of them passes."""
    on_foot = name == _PEDESTRIAN
    streets = network.walked() if on_foot else network.driven_by(ACTOR_KINDS[name].vclass)
    routes = None if streets is None else Routes.between_gates(streets)
    if streets is None or routes is None:
        return _Routes([], [], np.zeros(0), None)
    edges = [routes.drive(number) for number in range(len(routes.pairs))]
    weight = routes.weight.astype(np.float64)
    for place in places.values() if not on_foot else ():
        if any(place.passed_by(route) for route in edges if route):
            continue
        through = way_through(streets, place.first, place.last)
        if through is not None:
            edges.append(through)
            weight = np.append(weight, max(float(weight.max()), _TINY))
    if on_foot:
        sure = np.array([not _may_cross_elsewhere(streets, route) for route in edges])
        for place in places.values():  # If no certain route crosses there, uncertain ones are used.
            crosses = np.array([place.passed_by(route) for route in edges])
            sure |= crosses & ~(sure & crosses).any()
        weight = np.where(sure, weight, 0.0)
    turns: dict[str, set[str]] = {}
    for place in places.values():
        if place.turn:
            turns.setdefault(place.first, set()).add(place.last)
    # Where turns of an approach were counted, routes with other turns are not used.
    for number, route in enumerate(edges):
        if any(
            following not in turns.get(edge, {following}) for edge, following in pairwise(route)
        ):
            weight[number] = 0.0
    passed = [tuple(k for k, place in places.items() if place.passed_by(route)) for route in edges]
    return _Routes(edges, passed, weight, routes)


def _may_cross_elsewhere(streets: Streets, way: tuple[str, ...]) -> bool:
    """Return whether a similarly short alternative leads over the same junction.

    SUMO's pedestrians take it if the first signal is red, and are then counted elsewhere.
    """
    number = {name: k for k, name in enumerate(streets.edges)}
    edge_numbers = [number[name] for name in way]
    outside = [k for k, edge in enumerate(edge_numbers) if edge < streets.street_count]
    for first, last in pairwise(outside):
        inside = edge_numbers[first : last + 1]
        crossed = [edge for edge in inside if _CROSSING.search(streets.edges[edge])]
        if not crossed:
            continue
        graph = streets.seconds.tolil()
        graph[crossed, :] = 0
        other = scipy.sparse.csgraph.dijkstra(graph.tocsr(), indices=inside[0])[inside[-1]]
        used = sum(streets.seconds[a, b] for a, b in pairwise(inside))
        if other < used + _DETOUR_M:
            return True
    return False


def _trip(
    name: str,
    body: str,
    depart_s: float,
    ways: _Routes,
    way: int,
    warmup_s: float,
    random: np.random.Generator,
) -> Trip:
    if name != _PEDESTRIAN:
        return Trip(name, body, depart_s, ways.edges[way])
    assert ways.routes is not None
    lead_m = max(WALKING_MS * (warmup_s - depart_s), 0.0)
    # Pedestrians of the warm-up are spread over their route when the motion starts.
    spread = float(random.random()) if lead_m > 0 else 0.0
    return Trip(name, body, depart_s, *ways.routes.walk(way, spread, lead_m))


def way_through(streets: Streets, first: str, last: str) -> tuple[str, ...] | None:
    """Return the edges from border to border over two edges; ``None`` if there is no route.

    It uses the entry and the exit with the shortest travel time.
    """
    number = {name: k for k, name in enumerate(streets.edges)}
    start, end = number.get(first), number.get(last)
    if start is None or end is None:
        return None
    over = _path(streets.seconds, start, end) if start != end else [start]
    # A search on reversed edges finds the nearest entry.
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
    """Return the path from an edge to the nearest of some ends, by travel time."""
    seconds = scipy.sparse.csgraph.dijkstra(graph, indices=start)
    best = int(ends[np.argmin(seconds[ends])])
    return _path(graph, start, best) if np.isfinite(seconds[best]) else None


_ASSETS_PER_ROW = 100_000  # numbers of assets reserved for a row
_ROW_STREAM = 1000  # offset of random streams of rows, after those of the classes


def counted_demand(  # noqa: PLR0913 - all inputs of counts
    counts: Sequence[Mapping[str, Any]],
    roads: RoadNetwork,
    network: StreetNetwork,
    per_hour: Mapping[str, float],
    *,
    warmup_s: float,
    duration_s: float,
    seed: int,
    body: Callable[[str, int], str],
    evenly: bool = True,
) -> Demand:
    """Return the trips that reproduce counts, row by row; each row has its own random stream.

    Args:
        counts: ``traffic.counts`` of the site.
        roads: the lane network, with names and places of roads.
        network: its streets, without outer roads.
        per_hour: composition of motor traffic that is counted without a class.
        warmup_s: duration of traffic before the motion starts.
        duration_s: duration of the motion.
        seed: random seed.
        body: returns the asset of the n-th actor of a class.
        evenly: whether each row's traffic is spread evenly over time (`departures_of`).

    Raises:
        InputError: an approach or a turn does not exist; the message names the row.
    """
    if _may_count_twice(counts, roads):
        return fitted_demand(
            counts,
            roads,
            network,
            per_hour,
            warmup_s=warmup_s,
            duration_s=duration_s,
            seed=seed,
            body=body,
            evenly=evenly,
        )
    trips: list[tuple[Trip, int]] = []
    left_out: list[LeftOut] = []
    streets: dict[str, Streets | None] = {}
    owed: dict[str, float] = {}
    roads_of_rows: list[tuple[str, str]] = []
    for number, row in enumerate(counts):
        place = row.get("row") or f"traffic.counts[{number}]"
        movement = way_of(row, roads, place)
        roads_of_rows.append((movement.approach.id, movement.exit.id))
        for name, rates in rates_of(row, per_hour, place).items():
            vclass = ACTOR_KINDS[name].vclass
            if vclass not in streets:
                streets[vclass] = network.driven_by(vclass)
            class_streets = streets[vclass]
            edges = (
                None
                if class_streets is None
                else way_through(class_streets, movement.approach.id, movement.exit.id)
            )
            random = np.random.Generator(np.random.Philox(key=[seed, _ROW_STREAM + number]))
            wanted = wanted_of(rates, warmup_s, duration_s)
            departures_s = departures_of(wanted, owed.get(name, 0.5), random, evenly=evenly)
            owed[name] = (owed.get(name, 0.5) + sum(count for _, _, count in wanted)) % 1.0
            if edges is None:
                if len(departures_s):
                    why = (
                        f"no way from {movement.approach.id} to {movement.exit.id} for it ({place})"
                    )
                    left_out.append(LeftOut(name, len(departures_s), why))
                continue
            trips += [
                (
                    Trip(
                        name,
                        body(name, number * _ASSETS_PER_ROW + k),
                        round(float(time_s), 2),
                        edges,
                    ),
                    number,
                )
                for k, time_s in enumerate(departures_s)
            ]
    trips.sort(key=lambda numbered_trip: (numbered_trip[0].depart_s, numbered_trip[1]))
    rows: list[list[int]] = [[] for _ in counts]
    for number, (_, row_number) in enumerate(trips):
        rows[row_number].append(number)
    counted = tuple(
        CountedRow(*road_ids, tuple(row)) for road_ids, row in zip(roads_of_rows, rows, strict=True)
    )
    return Demand(tuple(trip for trip, _ in trips), tuple(left_out), counted=counted)


def _may_count_twice(counts: Sequence[Mapping[str, Any]], roads: RoadNetwork) -> bool:
    """Return whether rows may count the same vehicle, or count roads or crossings."""
    places = [row.get("row") or f"traffic.counts[{number}]" for number, row in enumerate(counts)]
    if any(row.get("road") or row.get("crossing") for row in counts):
        return True
    movements = [way_of(row, roads, place) for row, place in zip(counts, places, strict=True)]
    turns = [
        movement
        for movement in movements
        if movement.approach.to_junction == movement.exit.from_junction
    ]
    return len({movement.approach.to_junction for movement in turns}) > 1
