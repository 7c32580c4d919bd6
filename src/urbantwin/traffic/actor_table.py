"""The table of actors from SUMO's output: smoothed, with gait, standing on our ground."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import LabelledMesh
from urbantwin.progress import Progress, between, each, untold
from urbantwin.roads import RoadNetwork
from urbantwin.traffic.actor_rows import KeptRows, actor_rows
from urbantwin.traffic.assets import Asset
from urbantwin.traffic.demand.demand import Demand, Trip
from urbantwin.traffic.paths.apart import Parted, rear_of
from urbantwin.traffic.paths.bending import steering_part, vehicles, with_bodies
from urbantwin.traffic.paths.box_plan import PlanBoxes
from urbantwin.traffic.paths.corner_cutting import corner_cutters, with_rigid
from urbantwin.traffic.paths.detours import round_blocks
from urbantwin.traffic.paths.kerbs import Crossings
from urbantwin.traffic.paths.obstacles import Blocks, Obstacles
from urbantwin.traffic.paths.placement import Ground
from urbantwin.traffic.paths.solids import Solids
from urbantwin.traffic.paths.steering import steered
from urbantwin.traffic.paths.stretches import LeftOff, stretches
from urbantwin.traffic.paths.trajectory import smoothed
from urbantwin.traffic.paths.walked_cells import AROUND_M, WalkedCells
from urbantwin.traffic.paths.yielding import Before
from urbantwin.traffic.sumo.simulation import Simulated

__all__ = ["Place", "Tabled", "actor_table"]

#: Room that who is led needs beyond that of people, metres.
_LED_M = 0.2
#: What the table of actors is made from.
_SHOWN = ("trip", "step", "xy", "yaw", "distance", "speed", "lane")


Columns = dict[str, NDArray[Any]]


@dataclass(frozen=True, eq=False)
class Place:
    """What actors go between and stand on.

    Attributes:
        roads: the lanes.
        ground: what they stand on.
        blocks: what stands in their way all the time, in plan.
    """

    roads: RoadNetwork
    ground: Ground
    blocks: Blocks

    @classmethod
    def of(cls, roads: RoadNetwork, ground: Ground, scene: LabelledMesh, parked: pa.Table) -> Place:
        """Return the place with what of a scene, and which parked vehicles, stand in the way."""
        x, y, yaw, length, width = (
            parked[name].to_numpy() for name in ("x", "y", "yaw", "length", "width")
        )
        half = np.column_stack([length, width]) / 2
        cars = PlanBoxes(np.zeros(len(x), np.int64), np.column_stack([x, y]), yaw, half)
        return cls(roads, ground, Obstacles(scene).blocks(ground.top).with_cars(cars))


@dataclass(frozen=True, eq=False)
class Tabled:
    """What became of what SUMO saw.

    Attributes:
        actors: the table of actors.
        outside: how many poses were left out because there is no ground.
        rigid: who does not bend though its trip says so, by the numbers of their trips.
        poses: how far each trip is behind at each step, stretch by stretch, see `yielding.Before`;
            where tracks are numbers of trips.
    """

    actors: pa.Table
    outside: int
    rigid: frozenset[int]
    poses: tuple[Columns, ...]


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
    scratch: Path | None = None,
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
        scratch: a folder for rows of long motions; the system's when not given.
        tell: called with the fraction done (0..1) and what is being done.
    """
    smoothing = between(tell, 0.0, 0.4)
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
    step, lanes, shown = columns["step"], simulated.lanes, simulated.signals
    first, last = (int(step.min()), int(step.max()) + 1) if len(step) else (0, 1)
    parting = Parted(
        columns, trips, who, ground.levels(lanes), place.blocks, solids.shapes,
        place.roads.footway(0), step_s=step_s, asset=asset,
    )  # fmt: skip
    del columns, bent, simulated
    every = stretches(first, last, step_s)
    lead = who == vehicles(who)
    left, outside, poses = None, 0, []
    with _folder_for(len(every) > 1, scratch) as folder:
        kept = KeptRows(folder)
        for n, stretch in enumerate(every):
            telling = between(tell, 0.4 + 0.6 * n / len(every), 0.4 + 0.6 * (n + 1) / len(every))
            crossings = Crossings.of(place.roads, lanes, shown, stretch.begin, stretch.seen)
            was = before.stretch(n) if before else None
            parted = parting.parted(stretch, left, was, crossings, between(telling, 0.0, 0.2))
            left = LeftOff.of(parted, stretch.end)
            if by_trip:
                whose = lead[parted["trip"]]
                poses.append({name: parted[name][whose] for name in ("trip", "step", "behind")})
            decided = (parted["step"] >= max(stretch.begin, 0)) & (
                parted["step"] < min(stretch.end, steps)
            )
            shows = {name: values[decided] for name, values in parted.items() if name in _SHOWN}
            del parted
            rows = actor_rows(
                shows, trips, lanes, ground, step_s=step_s, asset=asset,
                tell=between(telling, 0.2, 1.0),
            )  # fmt: skip
            outside += int(decided.sum()) - rows.num_rows
            kept.add(rows)
            del shows, rows
        del parting
        table = kept.table(who if by_trip else None)
    return Tabled(table, outside, rigid, tuple(poses))


@contextmanager
def _folder_for(many: bool, scratch: Path | None) -> Iterator[Path | None]:
    """Yield a folder for the rows of many stretches; one is kept in memory."""
    if not many:
        yield None
        return
    with tempfile.TemporaryDirectory(prefix="rows-", dir=scratch) as name:
        yield Path(name)


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
        yaw[rows] = steered(path.xy, path.yaw, rear_of(steers))
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
