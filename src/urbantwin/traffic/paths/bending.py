"""Actors that bend: each of their stiff bodies becomes an actor of the motion."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from urbantwin.roads import Track
from urbantwin.traffic.assets import Asset
from urbantwin.traffic.assets.dog import BESIDE_M
from urbantwin.traffic.demand.demand import Demand, Trip
from urbantwin.traffic.paths.articulation import Poses, on_rails, towed
from urbantwin.traffic.sumo.simulation import Simulated

__all__ = ["steering_part", "vehicles", "with_bodies"]

Columns = dict[str, NDArray[Any]]

#: Turns of who is led on a lead are levelled over so many steps.
_LEAD_STEPS = 11

#: Further bodies are told from trips by so much; there are fewer trips than that.
_FURTHER = 10_000_000


def steering_part(whole: Asset, asset: Callable[[str], Asset]) -> Asset:
    """Return what of an actor goes first: its first body, where it leads others; else all of it.

    Args:
        whole: the actor.
        asset: an asset by name.
    """
    if not whole.bodies or whole.actor_class == "tram":
        return whole
    return asset(whole.bodies[0].asset)


def vehicles(who: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the number of the vehicle (T,) that each is a body of, see `with_bodies`."""
    return who % _FURTHER


def with_bodies(
    columns: Columns,
    demand: Demand,
    simulated: Simulated,
    tracks: Sequence[Track],
    *,
    asset: Callable[[str], Asset],
) -> tuple[Columns, tuple[Trip, ...], NDArray[np.int64]]:
    """Return poses in which vehicles that bend are their bodies, whom they are of, and who is who.

    The first body keeps the number of the vehicle's trip; the others have numbers after all trips.
    Who is who is told by numbers (T,) that depend on the vehicle's trip and the body alone.
    What is on an outer track, where there are no rails, is left out.

    Args:
        columns: poses by trip and step, sorted: ``trip``, ``step``, ``xy``, ``yaw`` and others; of
            who is towed those of the first body.
        demand: the trips.
        simulated: what SUMO saw: where on the rails trams are.
        tracks: the rails.
        asset: an asset by name.
    """
    trips, who = list(demand.trips), list(range(len(demand.trips)))
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
        elif whole.actor_class == "pedestrian":
            shown = [np.ones(len(rows), np.bool_)] * len(whole.bodies)
            poses = _accompanied(columns["xy"][rows], columns["yaw"][rows], number)
        else:
            shown = [np.ones(len(rows), np.bool_)] * len(whole.bodies)
            length_m = steering_part(whole, asset).length
            poses = towed(
                whole.bodies, columns["xy"][rows], columns["yaw"][rows], length_m=length_m
            )
        for k, (body, (middle, yaw)) in enumerate(zip(whole.bodies, poses, strict=True)):
            own = {name: values[rows] for name, values in columns.items()}
            own["xy"], own["yaw"] = middle, yaw
            own = {name: values[shown[k]] for name, values in own.items()}
            kind = asset(body.asset).actor_class
            part = replace(trip, actor_class=kind, asset=body.asset)
            if k == 0:
                trips[number] = part
            else:
                own["trip"] = np.full_like(own["trip"], len(trips))
                trips.append(part)
                who.append(number + k * _FURTHER)
            bent.append(own)
    if not bent:
        return columns, demand.trips, np.array(who, np.int64)
    rest = {name: values[stays] for name, values in columns.items()}
    joined = {name: np.concatenate([rest[name], *(x[name] for x in bent)]) for name in columns}
    return joined, tuple(trips), np.array(who, np.int64)


def _accompanied(xy: NDArray[np.float64], yaw: NDArray[np.float64], number: int) -> Poses:
    """Return where somebody (N, 2) walks, and a dog beside, who turns as gently as on a lead."""
    turned = np.unwrap(yaw)
    gentle = uniform_filter1d(turned, min(_LEAD_STEPS, len(turned)), mode="nearest")
    ahead, aside = BESIDE_M[0], BESIDE_M[1] * (1 if number % 2 else -1)
    c, s = np.cos(gentle), np.sin(gentle)
    place = xy + np.column_stack([ahead * c - aside * s, ahead * s + aside * c])
    return [(xy, yaw), (place, gentle)]


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
