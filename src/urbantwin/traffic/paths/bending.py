"""Actors that bend: each of their stiff bodies becomes an actor of the motion."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.roads import Track
from urbantwin.traffic.assets import Asset
from urbantwin.traffic.demand.demand import Demand, Trip
from urbantwin.traffic.paths.articulation import on_rails, towed
from urbantwin.traffic.sumo.simulation import Simulated

__all__ = ["with_bodies"]

Columns = dict[str, NDArray[Any]]


def with_bodies(
    columns: Columns,
    demand: Demand,
    simulated: Simulated,
    tracks: Sequence[Track],
    *,
    asset: Callable[[str], Asset],
) -> tuple[Columns, tuple[Trip, ...], list[int]]:
    """Return poses in which vehicles that bend are their bodies, whom they are of, and who leads.

    The first body keeps the number of the vehicle's trip; the others have numbers after all trips,
    and it leads them.
    What is on an outer track, where there are no rails, is left out.

    Args:
        columns: poses by trip and step, sorted: ``trip``, ``step``, ``xy``, ``yaw`` and others.
        demand: the trips.
        simulated: what SUMO saw: where on the rails trams are.
        tracks: the rails.
        asset: an asset by name.
    """
    trips = list(demand.trips)
    leaders = list(range(len(trips)))
    lines = {track.id: track.line[:, :2] for track in tracks}
    outer = {track.id for track in tracks if track.outer}
    bent: list[Columns] = []
    stays = np.ones(len(columns["trip"]), np.bool_)
    for number in np.unique(columns["trip"]).tolist():
        trip = demand.trips[number]
        whole = asset(trip.asset)
        if not whole.bodies:
            continue
        rows = np.flatnonzero(columns["trip"] == number)
        stays[rows] = False
        if trip.edges[0] in lines:
            source = _rows_of(simulated, number, columns["step"][rows])
            track, starts, edges, nose_m = _on_track(trip, simulated, source, lines)
            poses = on_rails(whole.bodies, track, nose_m)
            inside = np.array([edge not in outer for edge in edges])
            shown = [
                inside[np.searchsorted(starts[1:-1], nose_m - body.middle_m, side="right")]
                for body in whole.bodies
            ]
        else:
            shown = [np.ones(len(rows), np.bool_)] * len(whole.bodies)
            poses = towed(
                whole.bodies, columns["xy"][rows], columns["yaw"][rows], length_m=whole.length
            )
        for k, (body, (middle, yaw)) in enumerate(zip(whole.bodies, poses, strict=True)):
            own = {name: values[rows] for name, values in columns.items()}
            own["xy"], own["yaw"] = middle, yaw
            own = {name: values[shown[k]] for name, values in own.items()}
            part = replace(trip, asset=body.asset)
            if k == 0:
                trips[number] = part
            else:
                own["trip"] = np.full_like(own["trip"], len(trips))
                trips.append(part)
                leaders.append(number)
            bent.append(own)
    if not bent:
        return columns, demand.trips, leaders
    rest = {name: values[stays] for name, values in columns.items()}
    joined = {name: np.concatenate([rest[name], *(x[name] for x in bent)]) for name in columns}
    return joined, tuple(trips), leaders


def _rows_of(simulated: Simulated, number: int, steps: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return the rows of what SUMO saw of a trip at ascending steps."""
    rows = np.flatnonzero(simulated.trip == number)
    rows = rows[np.argsort(simulated.step[rows], kind="stable")]
    return np.asarray(rows[np.searchsorted(simulated.step[rows], steps)])


def _on_track(
    trip: Trip,
    simulated: Simulated,
    rows: NDArray[np.int64],
    lines: Mapping[str, NDArray[np.float64]],
) -> tuple[NDArray[np.float64], NDArray[np.float64], list[str], NDArray[np.float64]]:
    """Return a tram's route: its line, the stations between its edges, the edges; and its nose's.

    The nose's stations are those at rows (N,) of what SUMO saw.
    """
    edges = [edge for edge in trip.edges if edge in lines]
    shapes = [shapely.LineString(lines[edge]) for edge in edges]
    starts = np.concatenate([[0.0], np.cumsum([shape.length for shape in shapes])])
    at, nose_m = 0, np.empty(len(rows))
    for k, row in enumerate(rows.tolist()):
        edge = simulated.lanes[simulated.lane[row]].rpartition("_")[0]
        while at < len(edges) - 1 and edges[at] != edge:
            at += 1
        nose_m[k] = starts[at] + shapes[at].project(shapely.Point(simulated.front[row]))
    points = [lines[edges[0]]] + [lines[edge][1:] for edge in edges[1:]]
    return np.vstack(points), starts, edges, nose_m
