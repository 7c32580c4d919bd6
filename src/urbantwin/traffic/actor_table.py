"""The table of actors from SUMO's output: smoothed, with gait, standing on our ground."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pyarrow as pa
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import LabelledMesh
from urbantwin.progress import Progress, between, each, untold
from urbantwin.roads import RoadNetwork
from urbantwin.traffic.assets import Asset
from urbantwin.traffic.demand.demand import Demand, Trip
from urbantwin.traffic.motion import ACTOR_SCHEMA, step_times
from urbantwin.traffic.paths.absence import NOBODY, Absent, Bystanders, absent_from
from urbantwin.traffic.paths.bending import steering_part, vehicles, with_bodies
from urbantwin.traffic.paths.box_plan import PlanBoxes
from urbantwin.traffic.paths.corner_cutting import corner_cutters, with_rigid
from urbantwin.traffic.paths.crowd import crowd_walked
from urbantwin.traffic.paths.detours import round_blocks
from urbantwin.traffic.paths.kerbs import Crossings
from urbantwin.traffic.paths.obstacles import Blocks, Obstacles
from urbantwin.traffic.paths.placement import Ground, stand
from urbantwin.traffic.paths.separation import Moving, separated
from urbantwin.traffic.paths.solids import Solids
from urbantwin.traffic.paths.steering import steered
from urbantwin.traffic.paths.track_box import track_size
from urbantwin.traffic.paths.trajectory import smoothed
from urbantwin.traffic.paths.walked_cells import AROUND_M, WalkedCells
from urbantwin.traffic.paths.yielding import Before, yielded
from urbantwin.traffic.sumo.simulation import Simulated

__all__ = ["Place", "Tabled", "actor_table"]

_STANDING_MS = 0.15  # who is slower than this stands, m/s
_TURNS = 2  # vehicles go round people so often, who go round who waits
#: How long people who are late let vehicles by at a crossing without a signal, and at green, before
#: vehicles wait for them, seconds.
_PATIENCE_S = (15.0, 4.0)
#: Room that who is led needs beyond that of people, metres.
_LED_M = 0.2
_GOLDEN = (5**0.5 - 1) / 2  # spreads the first postures of those who set out together


Columns = dict[str, NDArray[Any]]


@dataclass(frozen=True, eq=False)
class Place:
    """What actors go between and stand on.

    Attributes:
        roads: the lanes.
        ground: what they stand on.
        blocks: what stands in their way all the time, in plan.
        obstacles: the static of it, as it is.
        parked: the rest.
        region: that is recorded.
    """

    roads: RoadNetwork
    ground: Ground
    blocks: Blocks
    obstacles: Obstacles
    parked: pa.Table
    region: shapely.Geometry

    @classmethod
    def of(
        cls,
        roads: RoadNetwork,
        ground: Ground,
        scene: LabelledMesh,
        parked: pa.Table,
        region: shapely.Geometry,
    ) -> Place:
        """Return the place with what of a scene, and which parked vehicles, stand in the way."""
        x, y, yaw, length, width = (
            parked[name].to_numpy() for name in ("x", "y", "yaw", "length", "width")
        )
        half = np.column_stack([length, width]) / 2
        cars = PlanBoxes(np.zeros(len(x), np.int64), np.column_stack([x, y]), yaw, half)
        obstacles = Obstacles(scene)
        blocks = obstacles.blocks(ground.top).with_cars(cars)
        return cls(roads, ground, blocks, obstacles, parked, region)


@dataclass(frozen=True, eq=False)
class Tabled:
    """What became of what SUMO saw.

    Attributes:
        actors: the table of actors.
        outside: how many poses were left out because there is no ground.
        rigid: who does not bend though its trip says so, by the numbers of their trips.
        poses: how far each trip is behind at each step, see `yielding.Before`.
        absent: who is left out, as it would pass through somebody; of rows before it was.
    """

    actors: pa.Table
    outside: int
    rigid: frozenset[int]
    poses: dict[str, NDArray[Any]]
    absent: Absent


def actor_table(  # noqa: PLR0913 - of a drive there is much to say
    simulated: Simulated,
    demand: Demand,
    place: Place,
    *,
    steps: int,
    step_s: float,
    asset: Callable[[str], Asset],
    by_trip: bool = False,
    before: Before | None = None,
    beside: Bystanders = NOBODY,
    tell: Progress = untold,
) -> Tabled:
    """Return the table of actors, and who of them is not as its trip says.

    Tracks are numbered in the order of setting out, and after them the further bodies of vehicles
    that bend.

    Args:
        simulated: what SUMO saw.
        demand: the trips that it refers to.
        place: what they go between and stand on.
        steps: how many steps the motion has; steps before and after them only shape the paths.
        step_s: time between steps.
        asset: an asset's dimensions and contacts by name.
        by_trip: let a track's number be that of its trip, whoever else is there.
        before: how the same traffic went until something changed.
        beside: who is there, or not, whomever it comes into.
        tell: called with the fraction done (0..1) and what is being done.
    """
    smoothing, standing = between(tell, 0.0, 0.4), between(tell, 0.5, 0.9)
    solids = _solids(simulated, demand, place)
    columns = _poses(simulated, demand, step_s=step_s, asset=asset, tell=smoothing)
    ground, tracks = place.ground, place.roads.tracks
    columns = _round_blocks(columns, simulated, demand.trips, place, solids, step_s)
    bent, trips, who = with_bodies(columns, demand, simulated, tracks, asset=asset)
    if before is not None:
        rigid = before.rigid
    else:
        level = ground.levels(simulated.lanes)[bent["lane"]]
        rigid = corner_cutters(bent, trips, who, place.blocks.low, level, asset)
    if rigid:
        demand = with_rigid(demand, rigid, asset)
        again = _poses(_of_trips(simulated, rigid), demand, step_s=step_s, asset=asset, tell=untold)
        columns = _exchanged(columns, again)
        bent, trips, who = with_bodies(columns, demand, simulated, tracks, asset=asset)
    # Who is led beside somebody goes round what stands there, too, and is longer.
    columns = _round_blocks(bent, simulated, trips, place, solids, step_s, led=True)
    tell(0.4, "past each other")
    columns = _apart(
        columns, simulated.lanes, trips, who, place, solids, before,
        Crossings.of(place.roads, simulated.lanes, simulated.signals, columns["step"]),
        step_s=step_s, asset=asset, tell=between(tell, 0.4, 0.5),
    )  # fmt: skip
    lead = (who == vehicles(who))[columns["trip"]]
    poses = {name: columns[name][lead] for name in ("trip", "step", "behind")}
    kept = (columns["step"] >= 0) & (columns["step"] < steps)
    columns = {name: values[kept] for name, values in columns.items()}
    names = np.array([trip.asset for trip in trips], object)
    trip = columns["trip"]
    tell(0.48, "heights of their lanes")
    ceiling = ground.ceiling(columns["xy"], columns["lane"], simulated.lanes)
    z, pitch, roll = np.full((3, len(trip)), np.nan)
    phase = np.zeros(len(trip), np.int16)
    known, kind = np.unique(names.astype(str), return_inverse=True)
    for name in each(sorted(set(names[trip])), standing, "on the ground"):
        rows = np.flatnonzero(kind[trip] == np.searchsorted(known, name))
        mesh = asset(name)
        xy, yaw = columns["xy"][rows], columns["yaw"][rows]
        z[rows], pitch[rows], roll[rows] = stand(ground, mesh.supports, xy, yaw, ceiling[rows])
        moving = np.zeros(len(rows))
        if mesh.phases > 1:
            cycles = columns["distance"][rows] / mesh.stride_m + trip[rows] * _GOLDEN
            moving = np.floor(cycles % 1.0 * mesh.phases).clip(0, mesh.phases - 1)
        phase[rows] = np.where(columns["speed"][rows] < _STANDING_MS, mesh.standing, moving)
    tell(0.9, "in the order of time")
    order = np.lexsort([trip, columns["step"]])
    order = order[~np.isnan(z[order])]
    trip = trip[order]
    driven, track = np.unique(trip, return_inverse=True)
    size = np.array([track_size(asset(names[number])) for number in driven]).reshape(-1, 3)[track]
    classes = [trip.actor_class for trip in trips]
    values = {
        "time_s": step_times(steps, step_s)[columns["step"][order]],
        "track": who[trip] if by_trip else track + 1,
        "class": _texts(classes, trip),
        "asset": _texts(names.tolist(), trip),
        "phase": phase[order],
        "x": columns["xy"][order, 0],
        "y": columns["xy"][order, 1],
        "z": z[order],
        "yaw": np.angle(np.exp(1j * columns["yaw"][order])),
        "pitch": pitch[order],
        "roll": roll[order],
        "length": size[:, 0],
        "width": size[:, 1],
        "height": size[:, 2],
        "speed": columns["speed"][order],
        "lane": _texts(simulated.lanes, columns["lane"][order]),
    }
    table = pa.table(
        [pa.array(values[one.name], one.type) for one in ACTOR_SCHEMA], schema=ACTOR_SCHEMA
    )
    absent = absent_from(
        table, _whose(trips, who)[trip], vehicles(who)[trip], place.parked, place.obstacles,
        place.region, step_s=step_s, beside=beside,
    )  # fmt: skip
    return Tabled(
        _there(table, absent, by_trip=by_trip), int(np.isnan(z).sum()), rigid, poses, absent
    )


def _there(table: pa.Table, absent: Absent, *, by_trip: bool) -> pa.Table:
    """Return the rows of who is there, tracks numbered anew unless they are numbers of trips."""
    if not absent.rows.any():
        return table
    table = table.filter(pa.array(~absent.rows))
    if by_trip:
        return table
    _, track = np.unique(table["track"].to_numpy(), return_inverse=True)
    column = table.schema.get_field_index("track")
    return table.set_column(column, table.schema.field(column), pa.array(track + 1, pa.int32()))


def _whose(trips: Sequence[Trip], who: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the vehicle that each trip (T,) is a body of; who is led is one of its own."""
    led = np.array([trip.actor_class == "animal" for trip in trips], np.bool_)
    return np.where(led, who, vehicles(who))


def _solids(simulated: Simulated, demand: Demand, place: Place) -> Solids:
    """Return what stands near people's ways."""
    walks = np.array([trip.actor_class == "pedestrian" for trip in demand.trips], np.bool_)
    walked = simulated.front[walks[simulated.trip]] if len(walks) else np.zeros((0, 2))
    return Solids(place.blocks.low, walked, place.roads.footway(0))


def _round_blocks(
    columns: Columns,
    simulated: Simulated,
    trips: Sequence[Trip],
    place: Place,
    solids: Solids,
    step_s: float,
    *,
    led: bool = False,
) -> Columns:
    """Return poses in which people on the ground, or whom they lead, go round what stands."""
    kind = "animal" if led else "pedestrian"
    afoot = np.array([trip.actor_class == kind for trip in trips], np.bool_)
    level = place.ground.levels(simulated.lanes)[columns["lane"]]
    walks = afoot[columns["trip"]] & (level == 0)
    footway = place.roads.footway(0)
    if not walks.any():
        return columns
    shapes = shapely.buffer(solids.shapes, _LED_M) if led else solids.shapes
    cells = WalkedCells(columns["xy"][walks], shapes, footway, AROUND_M)
    return round_blocks(columns, walks, cells, step_s)


def _poses(
    simulated: Simulated,
    demand: Demand,
    *,
    step_s: float,
    asset: Callable[[str], Asset],
    tell: Progress,
) -> dict[str, NDArray[Any]]:
    """Return smoothed poses, trip by trip, as columns."""
    order = np.lexsort([simulated.step, simulated.trip])
    trip, step = simulated.trip[order], simulated.step[order]
    breaks = np.flatnonzero((np.diff(trip) != 0) | (np.diff(step) != 1)) + 1
    xy = np.empty((len(order), 2))
    yaw, distance, speed = np.empty((3, len(order)))
    tracks = np.split(np.arange(len(order)), breaks) if len(order) else []
    for rows in each(tracks, tell, "smoothing their paths"):
        whose, source = demand.trips[trip[rows[0]]], order[rows]
        steers = steering_part(asset(whose.asset), asset)
        path = smoothed(
            simulated.front[source],
            simulated.angle_deg[source],
            simulated.speed[source],
            step_s=step_s,
            length_m=steers.length,
            walks=whose.actor_class == "pedestrian",
        )
        xy[rows], distance[rows], speed[rows] = path.xy, path.distance_m, path.speed
        yaw[rows] = steered(path.xy, path.yaw, _rear_m(steers))
    return {
        "trip": trip,
        "step": step,
        "xy": xy,
        "yaw": yaw,
        "distance": distance,
        "speed": speed,
        "lane": simulated.lane[order],
    }


def _of_trips(simulated: Simulated, numbers: frozenset[int]) -> Simulated:
    """Return what SUMO saw of some trips."""
    return simulated.only(np.isin(simulated.trip, list(numbers)))


def _exchanged(
    columns: dict[str, NDArray[Any]], again: dict[str, NDArray[Any]]
) -> dict[str, NDArray[Any]]:
    """Return poses in which some trips have other ones, sorted as before."""
    stays = ~np.isin(columns["trip"], again["trip"])
    joined = {name: np.concatenate([columns[name][stays], again[name]]) for name in columns}
    order = np.lexsort([joined["step"], joined["trip"]])
    return {name: values[order] for name, values in joined.items()}


def _apart(  # noqa: PLR0913 - all that they go between
    columns: dict[str, NDArray[Any]],
    lanes: Sequence[str],
    trips: Sequence[Trip],
    who: NDArray[np.int64],
    place: Place,
    solids: Solids,
    before: Before | None,
    crossings: Crossings,
    *,
    step_s: float,
    asset: Callable[[str], Asset],
    tell: Progress,
) -> dict[str, NDArray[Any]]:
    """Return poses of which no two overlap, where that can be had."""
    meshes = [asset(trip.asset) for trip in trips]
    trip, stands = columns["trip"], columns["speed"] < _STANDING_MS
    striding = np.array([[mesh.length, mesh.width] for mesh in meshes]).reshape(-1, 2)
    still = np.array([track_size(mesh)[:2] for mesh in meshes]).reshape(-1, 2)
    size = np.where(stands[:, None], still[trip], striding[trip])
    level = place.ground.levels(lanes)[columns["lane"]]
    boxes = PlanBoxes(columns["step"], columns["xy"], columns["yaw"], size / 2)
    # Who is led steps aside as people do.
    classes = tuple(
        "pedestrian" if one.actor_class == "animal" else one.actor_class for one in trips
    )
    moving = Moving(
        trip, boxes, columns["speed"], level, columns["lane"], classes, _whose(trips, who)
    )
    footway, half = place.roads.footway(0), still[trip] / 2

    on_foot = np.array([name == "pedestrian" for name in classes], np.bool_)[trip]
    columns = {**columns, "aside": np.zeros(len(trip))}
    afoot = {name: values[on_foot] for name, values in columns.items()}

    height = np.array([mesh.height for mesh in meshes])[trip]
    behind = []
    for turn in range(_TURNS + 1):
        # Everybody on foot goes its own way anew: what held it up in one turn may not in the next.
        for name, values in afoot.items():
            columns[name][on_foot] = values
        columns = crowd_walked(
            columns, moving, half, step_s, place.blocks.low, solids.shapes, footway,
            crossings=crossings, patience_s=_PATIENCE_S,
        )  # fmt: skip
        if turn < _TURNS:
            columns = _round_others(columns, moving, size / 2, height, place.blocks, meshes, step_s)
        was = before.turn(turn) if before else None
        waiting = between(tell, turn / (_TURNS + 1), (turn + 1) / (_TURNS + 1))
        columns = yielded(columns, moving, half, step_s, was, waiting)
        behind.append(columns.pop("behind"))
    return {**columns, "behind": np.column_stack(behind)}


def _round_others(
    columns: Columns,
    moving: Moving,
    half: NDArray[np.float64],
    height: NDArray[np.float64],
    blocks: Blocks,
    meshes: Sequence[Asset],
    step_s: float,
) -> Columns:
    """Return poses in which vehicles go round what is beside them a little."""
    boxes = PlanBoxes(columns["step"], columns["xy"], columns["yaw"], half)
    now = replace(moving, boxes=boxes, speed=columns["speed"])
    xy, speed = separated(now, blocks, height, step_s, columns["aside"])
    aside = columns["aside"] + ((xy - columns["xy"]) * boxes.axes[:, 1]).sum(axis=1)
    changed = {**columns, "xy": xy, "speed": speed, "aside": aside}
    return _steered(changed, columns, moving.classes, meshes)


def _steered(
    columns: dict[str, NDArray[Any]],
    was: dict[str, NDArray[Any]],
    classes: Sequence[str],
    meshes: Sequence[Asset],
) -> dict[str, NDArray[Any]]:
    """Return poses in which every vehicle whose path is another than it was drives along it."""
    trip, xy = columns["trip"], columns["xy"]
    yaw = columns["yaw"].copy()
    breaks = np.flatnonzero((np.diff(trip) != 0) | (np.diff(columns["step"]) != 1)) + 1
    for rows in np.split(np.arange(len(trip)), breaks):
        number = trip[rows[0]] if len(rows) else 0
        if (xy[rows] != was["xy"][rows]).any() and classes[number] != "pedestrian":
            yaw[rows] = steered(xy[rows], yaw[rows], _rear_m(meshes[number]))
    return {**columns, "yaw": yaw}


def _rear_m(mesh: Asset) -> float:
    """Return how far behind its middle an asset's rear axle is, metres; 0 without one.

    A tram has none in this sense: both its bogies are on the rails, as SUMO's heading has them.
    """
    if mesh.actor_class == "tram":
        return 0.0
    behind = mesh.contacts[mesh.contacts[:, 0] < -0.1, 0]
    return -float(behind.mean()) if len(behind) else 0.0


def _texts(names: Sequence[str], index: NDArray[Any]) -> pa.Array:
    """Return ``names[index]`` as a column, without a Python object per row."""
    indices = pa.array(index.astype(np.int32))
    return pa.DictionaryArray.from_arrays(indices, pa.array(names, pa.string())).cast(pa.string())
