"""Articulated vehicles: each of their rigid bodies becomes an actor of the motion."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from urbantwin.geometry import stations_of_points
from urbantwin.roads import Track
from urbantwin.traffic.assets import Asset
from urbantwin.traffic.assets.gait import BESIDE_M
from urbantwin.traffic.assets.heavy import Body
from urbantwin.traffic.demand.demand import Demand, Trip
from urbantwin.traffic.paths.box_plan import PlanBoxes, meetings, near_pairs
from urbantwin.traffic.paths.obstacles import Outlines
from urbantwin.traffic.sumo.simulation import Simulated

__all__ = [
    "Poses",
    "corner_cutters",
    "on_rails",
    "steering_part",
    "towed",
    "vehicles",
    "with_bodies",
    "with_rigid",
]

#: Overlap up to which boxes only touch, metres.
_TOUCH_TOLERANCE_M = 0.05
#: Classes whose further bodies are not towed.
_NOT_TOWED = ("tram", "animal")


def corner_cutters(
    columns: dict[str, NDArray[Any]],
    trips: Sequence[Trip],
    who: NDArray[np.int64],
    blocks: PlanBoxes,
    level: NDArray[np.integer],
    asset: Callable[[str], Asset],
) -> frozenset[int]:
    """Return the trips of articulated vehicles with a towed body that overlaps others.

    Args:
        columns: poses by trip and step, with the bodies of articulated vehicles (`with_bodies`).
        trips: their trips.
        who: identities of the trips, see `with_bodies`.
        blocks: obstacles at every step.
        level: (N,) level of the road of each row.
        asset: returns an asset by name.
    """
    is_towed_body = who != vehicles(who)
    towed = is_towed_body & np.array(
        [trip.actor_class not in _NOT_TOWED for trip in trips], np.bool_
    )
    if not towed.any():
        return frozenset()
    meshes = [asset(trip.asset) for trip in trips]
    half = np.array([[mesh.length, mesh.width] for mesh in meshes])[columns["trip"]] / 2
    boxes = PlanBoxes(columns["step"], columns["xy"], columns["yaw"], half)
    rows = np.flatnonzero(towed[columns["trip"]])
    # Actors near towed bodies at the same step.
    at_step = np.isin(columns["step"], columns["step"][rows])
    rows_at_step = np.flatnonzero(at_step)
    pairs = rows_at_step[near_pairs(boxes.take(rows_at_step), 0.0)]
    row_towed, vehicle = towed[columns["trip"]], vehicles(who)[columns["trip"]]
    first, second = pairs.T
    involved = (row_towed[first] | row_towed[second]) & (vehicle[first] != vehicle[second])
    pairs = pairs[involved & (level[first] == level[second])]
    deep, _ = meetings(boxes, pairs)
    hit = pairs[deep > _TOUCH_TOLERANCE_M].ravel()
    row, block = Outlines(blocks.polygons).beside(boxes.take(rows))
    both = PlanBoxes.joined([boxes.take(rows), blocks])
    deep, _ = meetings(both, np.column_stack([row, block + len(rows)]))
    hit = np.concatenate([hit, rows[row[deep > _TOUCH_TOLERANCE_M]]])
    return frozenset(vehicle[hit[row_towed[hit]]].tolist())


def with_rigid(demand: Demand, numbers: frozenset[int], asset: Callable[[str], Asset]) -> Demand:
    """Return a demand in which the vehicles of some trips are rigid.

    Args:
        demand: the trips.
        numbers: numbers of these trips.
        asset: returns an asset by name.
    """
    trips = list(demand.trips)
    for number in numbers:
        trips[number] = replace(trips[number], asset=asset(trips[number].asset).rigid)
    return replace(demand, trips=tuple(trips))


#: Step of a towed axle, metres: small enough to follow a tractrix.
_STEP_M = 0.05

Poses = list[tuple[NDArray[np.float64], NDArray[np.float64]]]


def on_rails(
    bodies: Sequence[Body], track: NDArray[np.float64], nose_m: NDArray[np.float64]
) -> Poses:
    """Return the poses of bodies whose guides lie on a track.

    Args:
        bodies: bodies from the nose.
        track: (P, 2) points of the track, back to the vehicle's end, metres.
        nose_m: (N,) position of the nose along the track, metres; the track is extended straight at
            both ends.

    Returns:
        For each body the centre (N, 2) and the heading (N,), rad, continuous.
    """
    return [
        _pose_between_guides(
            body, *(_points_on_track(track, nose_m - guide) for guide in body.guides_m)
        )
        for body in bodies
    ]


def towed(
    bodies: Sequence[Body],
    middle: NDArray[np.float64],
    yaw: NDArray[np.float64],
    *,
    length_m: float,
) -> Poses:
    """Return the poses of bodies of which the first drives and the others are towed.

    Args:
        bodies: bodies from the nose; the first guide of a towed one is its joint.
        middle: (N, 2) centre of the rigid part at the nose, site frame.
        yaw: (N,) heading of the first, rad.
        length_m: length of that part.

    Returns:
        For each body the centre (N, 2) and the heading (N,), rad, continuous.
    """
    nose = middle + _unit(yaw) * (length_m / 2)
    first = bodies[0]
    poses = [(nose - _unit(yaw) * first.middle_m, yaw)]
    ahead_m, ahead = first.middle_m, poses[0]
    for body in bodies[1:]:
        joint = ahead[0] + _unit(ahead[1]) * (ahead_m - body.guides_m[0])
        axle = _tractrix(joint, float(ahead[1][0]), body.guides_m[1] - body.guides_m[0])
        ahead_m, ahead = body.middle_m, _pose_between_guides(body, joint, axle)
        poses.append(ahead)
    return poses


def _pose_between_guides(
    body: Body, front: NDArray[np.float64], rear: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the centre and heading of a body from its guides, each (N, 2)."""
    chord = front - rear
    yaw = np.unwrap(np.arctan2(chord[:, 1], chord[:, 0]))
    guides = (front + rear) / 2
    return guides + _unit(yaw) * (sum(body.guides_m) / 2 - body.middle_m), yaw


def _points_on_track(track: NDArray[np.float64], at_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the points (N, 2) of a track at stations, extrapolated straight beyond its ends."""
    along = stations_of_points(track)
    points = np.column_stack([np.interp(at_m, along, track[:, k]) for k in (0, 1)])
    for end, inner, beyond in ((0, 1, at_m), (-1, -2, at_m - along[-1])):
        out = np.maximum(-beyond if end == 0 else beyond, 0.0)
        ahead = (track[end] - track[inner]) / max(np.linalg.norm(track[end] - track[inner]), 1e-9)
        points += out[:, None] * ahead
    return np.asarray(points)


def _tractrix(joint: NDArray[np.float64], yaw: float, bar_m: float) -> NDArray[np.float64]:
    """Return positions (N, 2) of an axle towed by a bar behind a joint (N, 2)."""
    axle = np.empty_like(joint)
    axle[0] = joint[0] - bar_m * np.array([np.cos(yaw), np.sin(yaw)])
    # Plain numbers, since arrays of two values take ten times as long.
    (from_x, from_y), (x, y) = joint[0].tolist(), axle[0].tolist()
    for k, (to_x, to_y) in enumerate(joint[1:].tolist(), 1):
        leg_x, leg_y = to_x - from_x, to_y - from_y
        steps = max(1, math.ceil(math.sqrt(leg_x * leg_x + leg_y * leg_y) / _STEP_M))
        for step in range(1, steps + 1):
            share = step / steps
            pull_x, pull_y = from_x + share * leg_x, from_y + share * leg_y
            bar_x, bar_y = x - pull_x, y - pull_y
            drawn = bar_m / max(math.sqrt(bar_x * bar_x + bar_y * bar_y), 1e-9)
            x, y = pull_x + bar_x * drawn, pull_y + bar_y * drawn
        axle[k] = x, y
        from_x, from_y = to_x, to_y
    return axle


def _unit(yaw: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.column_stack([np.cos(yaw), np.sin(yaw)])


Columns = dict[str, NDArray[Any]]

#: Number of steps over which turns of an animal on a lead are smoothed.
_LEAD_STEPS = 11

#: Offset of identities of further bodies; larger than the number of trips.
_BODY_ID_OFFSET = 10_000_000


def steering_part(whole: Asset, asset: Callable[[str], Asset]) -> Asset:
    """Return the steered part of an actor: its first body if it tows others; else the whole.

    Args:
        whole: the actor.
        asset: returns an asset by name.
    """
    if not whole.bodies or whole.actor_class == "tram":
        return whole
    return asset(whole.bodies[0].asset)


def vehicles(who: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the number of the vehicle (T,) of each body, see `with_bodies`."""
    return who % _BODY_ID_OFFSET


def with_bodies(
    columns: Columns,
    demand: Demand,
    simulated: Simulated,
    tracks: Sequence[Track],
    *,
    asset: Callable[[str], Asset],
) -> tuple[Columns, tuple[Trip, ...], NDArray[np.int64]]:
    """Return poses with the bodies of articulated vehicles, their trips, and their identities.

    The first body keeps the number of the vehicle's trip; the others have numbers after all trips.
    Identities (T,) depend only on the vehicle's trip and the body. Bodies on an outer track,
    without rails, are left out.

    Args:
        columns: poses by trip and step, sorted: ``trip``, ``step``, ``xy``, ``yaw`` and others; of
            towing vehicles those of the first body.
        demand: the trips.
        simulated: SUMO's output, for the positions of trams on the rails.
        tracks: the rails.
        asset: returns an asset by name.
    """
    trips, actor_ids = list(demand.trips), list(range(len(demand.trips)))
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
                actor_ids.append(number + k * _BODY_ID_OFFSET)
            bent.append(own)
    if not bent:
        return columns, demand.trips, np.array(actor_ids, np.int64)
    rest = {name: values[stays] for name, values in columns.items()}
    joined = {name: np.concatenate([rest[name], *(x[name] for x in bent)]) for name in columns}
    return joined, tuple(trips), np.array(actor_ids, np.int64)


def _accompanied(xy: NDArray[np.float64], yaw: NDArray[np.float64], number: int) -> Poses:
    """Return the poses of a pedestrian (N, 2), and of a dog beside, with smooth turns."""
    turned = np.unwrap(yaw)
    gentle = uniform_filter1d(turned, min(_LEAD_STEPS, len(turned)), mode="nearest")
    ahead, beside_m = BESIDE_M[0], BESIDE_M[1] * (1 if number % 2 else -1)
    c, s = np.cos(gentle), np.sin(gentle)
    place = xy + np.column_stack([ahead * c - beside_m * s, ahead * s + beside_m * c])
    return [(xy, yaw), (place, gentle)]


def _rows_of(simulated: Simulated, number: int, steps: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return the rows of SUMO's output of a trip at ascending steps."""
    rows = np.flatnonzero(simulated.trip == number)
    rows = rows[np.argsort(simulated.step[rows], kind="stable")]
    return np.asarray(rows[np.searchsorted(simulated.step[rows], steps)])


def _on_track(
    trip: Trip,
    simulated: Simulated,
    rows: NDArray[np.int64],
    lines: Mapping[str, NDArray[np.float64]],
) -> tuple[NDArray[np.float64], NDArray[np.float64], list[str], NDArray[np.float64]]:
    """Return a tram's line, the stations between its edges, the edges, and its nose's stations.

    The nose's stations are those at rows (N,) of SUMO's output.
    """
    edges = [edge for edge in trip.edges if edge in lines]
    shapes = [shapely.LineString(lines[edge]) for edge in edges]
    starts = np.concatenate([[0.0], np.cumsum([shape.length for shape in shapes])])
    edge_index, nose_m = 0, np.empty(len(rows))
    for k, row in enumerate(rows.tolist()):
        edge = simulated.lanes[simulated.lane[row]].rpartition("_")[0]
        while edge_index < len(edges) - 1 and edges[edge_index] != edge:
            edge_index += 1
        nose_m[k] = starts[edge_index] + shapes[edge_index].project(
            shapely.Point(simulated.front[row])
        )
    points = [lines[edges[0]]] + [lines[edge][1:] for edge in edges[1:]]
    return np.vstack(points), starts, edges, nose_m
