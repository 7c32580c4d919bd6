"""Paths of actors from SUMO's output: smoothed, around obstacles, with all bodies of each vehicle.

Each path depends on the output of one actor alone, so that those of a long motion are made for some
actors at a time, and kept on disk.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.progress import Progress, between, each, untold
from urbantwin.roads import RoadNetwork
from urbantwin.traffic.assets import Asset
from urbantwin.traffic.demand.demand import Demand, Trip
from urbantwin.traffic.freed_memory import hand_back_freed_memory
from urbantwin.traffic.paths.apart import rear_of
from urbantwin.traffic.paths.bending import (
    corner_cutters,
    steering_part,
    vehicles,
    with_bodies,
    with_rigid,
)
from urbantwin.traffic.paths.box_plan import PlanBoxes
from urbantwin.traffic.paths.detours import round_blocks
from urbantwin.traffic.paths.kept_ways import KeptColumns, KeptWays, some_actors
from urbantwin.traffic.paths.placement import Ground
from urbantwin.traffic.paths.trajectory import smoothed, steered
from urbantwin.traffic.paths.walked_ground import AROUND_M, Solids, WalkedCells
from urbantwin.traffic.sumo.simulation import Simulated

__all__ = ["actor_ways"]

#: Extra clearance of accompanying animals, beyond that of pedestrians, metres.
_ANIMAL_CLEARANCE_M = 0.2
#: Number of steps checked together for corner cutting.
_STEPS_AT_ONCE = 2000

Columns = dict[str, NDArray[Any]]


@dataclass(frozen=True, eq=False)
class _PathStages:
    """The surroundings of the paths, and how paths are made from SUMO's output."""

    roads: RoadNetwork
    ground: Ground
    low: PlanBoxes
    solids: Solids
    lanes: tuple[str, ...]
    step_s: float
    asset: Callable[[str], Asset]

    def ways(self, simulated: Simulated, demand: Demand, tell: Progress) -> Columns:
        """Return the smoothed poses of all actors, with pedestrians around obstacles."""
        columns = self.smooth(simulated, demand, tell)
        return self.round(columns, demand.trips)

    def bent(
        self, columns: Columns, demand: Demand, simulated: Simulated
    ) -> tuple[Columns, tuple[Trip, ...], NDArray[np.int64]]:
        """Return the poses of all bodies, their trips, and the trip that each belongs to."""
        return with_bodies(columns, demand, simulated, self.roads.tracks, asset=self.asset)

    def cutters(
        self, columns: Columns, trips: Sequence[Trip], who: NDArray[np.int64]
    ) -> frozenset[int]:
        """Return the trips of vehicles whose further bodies overlap an actor or an obstacle."""
        level = self.ground.levels(self.lanes)[columns["lane"]]
        return corner_cutters(columns, trips, who, self.low, level, self.asset)

    def round(self, columns: Columns, trips: Sequence[Trip], *, led: bool = False) -> Columns:
        """Return poses in which pedestrians (or accompanying animals) avoid obstacles."""
        kind = "animal" if led else "pedestrian"
        afoot = np.array([trip.actor_class == kind for trip in trips], np.bool_)
        level = self.ground.levels(self.lanes)[columns["lane"]]
        walks = afoot[columns["trip"]] & (level == 0)
        if not walks.any():
            return columns
        shapes = (
            shapely.buffer(self.solids.shapes, _ANIMAL_CLEARANCE_M) if led else self.solids.shapes
        )
        cells = WalkedCells(columns["xy"][walks], shapes, self.roads.footway(0), AROUND_M)
        return round_blocks(columns, walks, cells, self.step_s)

    def smooth(self, simulated: Simulated, demand: Demand, tell: Progress) -> Columns:
        """Return smoothed poses as columns, sorted by trip and step."""
        order = simulated.by_trip()
        trip, step = simulated.trip[order], simulated.step[order]
        breaks = np.flatnonzero((np.diff(trip) != 0) | (np.diff(step) != 1)) + 1
        xy = np.empty((len(order), 2))
        yaw, distance, speed = np.empty((3, len(order)))
        tracks = np.split(np.arange(len(order)), breaks) if len(order) else []
        for rows in each(tracks, tell, "smoothing their paths"):
            actor, source = demand.trips[trip[rows[0]]], order[rows]
            steers = steering_part(self.asset(actor.asset), self.asset)
            path = smoothed(
                simulated.front[source],
                simulated.angle_deg[source],
                simulated.speed[source],
                step_s=self.step_s,
                length_m=steers.length,
                walks=actor.actor_class == "pedestrian",
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


def actor_ways(  # noqa: PLR0913 - all surroundings of a path
    simulated: Simulated,
    demand: Demand,
    roads: RoadNetwork,
    ground: Ground,
    low: PlanBoxes,
    solids: Solids,
    *,
    step_s: float,
    asset: Callable[[str], Asset],
    rigid: frozenset[int] | None,
    folder: Path | None,
    tell: Progress,
) -> KeptWays:
    """Return the paths of all actors.

    Args:
        simulated: SUMO's output.
        demand: the trips that it refers to.
        roads: the lanes.
        ground: ground, for the level of each lane.
        low: obstacles near the ground, in plan.
        solids: outlines of obstacles near pedestrians' paths.
        step_s: time between steps, seconds.
        asset: returns an asset's dimensions and contacts by name.
        rigid: trips of vehicles that are rigid; ``None`` determines them here.
        folder: folder for long paths; ``None`` keeps them in memory.
        tell: called with the fraction done (0..1) and what is being done.
    """
    stages = _PathStages(roads, ground, low, solids, simulated.lanes, step_s, asset)
    step = simulated.step
    steps = (int(step.min()), int(step.max()) + 1) if len(step) else (0, 1)
    stored = KeptColumns(folder)
    if folder is None:
        columns = stages.ways(simulated, demand, tell)
        bent, trips, actor_ids = stages.bent(columns, demand, simulated)
        rigid = stages.cutters(bent, trips, actor_ids) if rigid is None else rigid
        if rigid:
            demand = with_rigid(demand, rigid, asset)
            again = stages.smooth(_of_trips(simulated, rigid), demand, untold)
            bent, trips, actor_ids = stages.bent(
                _with_replaced_trips(columns, again), demand, simulated
            )
        # An animal beside its owner avoids obstacles, too, and is longer.
        stored.add(stages.round(bent, trips, led=True))
        return KeptWays(stored, trips, actor_ids, rigid, frozenset(), 0, steps)
    all_trips, number = list(demand.trips), list(range(len(demand.trips)))
    count = 0
    parts = list(some_actors(simulated.trip))
    for n, rows in enumerate(parts):
        telling = between(tell, n / len(parts), (n + 1) / len(parts))
        seen = simulated.only(rows)
        bent, trips, actor_ids = stages.bent(stages.ways(seen, demand, telling), demand, seen)
        bent = stages.round(bent, trips, led=True)
        further = bent["trip"] >= len(demand.trips)
        bent["trip"][further] += len(all_trips) - len(demand.trips)
        for trip_index in np.unique(seen.trip).tolist():
            all_trips[trip_index] = trips[trip_index]
        all_trips += trips[len(demand.trips) :]
        number += actor_ids[len(demand.trips) :].tolist()
        count += len(bent["trip"])
        stored.add(bent)
        del seen, bent, rows
    del parts
    hand_back_freed_memory()
    trips, actor_ids = tuple(all_trips), np.array(number, np.int64)
    if rigid is None:
        rigid = frozenset().union(
            *(stages.cutters(columns, trips, actor_ids) for columns in _some_steps(stored, steps))
        )
    removed: frozenset[int] = frozenset()
    if rigid:
        removed = frozenset(np.flatnonzero(np.isin(vehicles(actor_ids), list(rigid))).tolist())
        demand = with_rigid(demand, rigid, asset)
        stored.add(stages.smooth(_of_trips(simulated, rigid), demand, untold))
        trips = tuple(demand.trips[n] if n in rigid else trip for n, trip in enumerate(trips))
    return KeptWays(stored, trips, actor_ids, rigid, removed, count, steps)


def _some_steps(kept: KeptColumns, steps: tuple[int, int]) -> Iterator[Columns]:
    """Yield rows in groups of consecutive steps."""
    step = kept.opened()["step"]
    for first in range(*steps, _STEPS_AT_ONCE):
        yield kept.rows(np.flatnonzero((step >= first) & (step < first + _STEPS_AT_ONCE)))


def _of_trips(simulated: Simulated, numbers: frozenset[int]) -> Simulated:
    """Return SUMO's output of some trips."""
    return simulated.only(np.isin(simulated.trip, list(numbers)))


def _with_replaced_trips(
    columns: dict[str, NDArray[Any]], again: dict[str, NDArray[Any]]
) -> dict[str, NDArray[Any]]:
    """Return poses in which those of some trips are replaced, sorted as before."""
    stays = ~np.isin(columns["trip"], again["trip"])
    joined = {name: np.concatenate([columns[name][stays], again[name]]) for name in columns}
    order = np.lexsort([joined["step"], joined["trip"]])
    return {name: values[order] for name, values in joined.items()}
