"""The table of actors from SUMO's output: smoothed paths, conflicts resolved, on the ground."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import LabelledMesh
from urbantwin.progress import Progress, between, untold
from urbantwin.roads import RoadNetwork
from urbantwin.traffic.actor_rows import KeptRows, actor_rows
from urbantwin.traffic.actor_ways import actor_ways
from urbantwin.traffic.assets import Asset
from urbantwin.traffic.demand.demand import Demand
from urbantwin.traffic.freed_memory import hand_back_freed_memory
from urbantwin.traffic.motion_rows import ActorRows
from urbantwin.traffic.paths.absence import NOBODY, Absent, Bystanders, absent_from
from urbantwin.traffic.paths.apart import Parted
from urbantwin.traffic.paths.bending import vehicles
from urbantwin.traffic.paths.box_plan import PlanBoxes
from urbantwin.traffic.paths.crowd import Crossings
from urbantwin.traffic.paths.obstacles import Blocks, Obstacles
from urbantwin.traffic.paths.overlap import overlaps_told
from urbantwin.traffic.paths.placement import Ground
from urbantwin.traffic.paths.stretches import LeftOff, stretches
from urbantwin.traffic.paths.walked_ground import Solids
from urbantwin.traffic.paths.yielding import Before
from urbantwin.traffic.sumo.simulation import Simulated

__all__ = ["Place", "Tabled", "actor_table"]

#: Motions with more poses are kept on disk while they are made.
_MAX_POSES_IN_MEMORY = 600_000
#: Progress after which paths are smoothed, conflicts resolved, and actors placed on the ground.
_AFTER_SMOOTHING, _AFTER_CONFLICTS, _AFTER_PLACING = 0.1, 0.82, 0.93
#: Columns that the table of actors is made from.
_TABLE_COLUMNS = ("trip", "step", "xy", "yaw", "distance", "speed", "lane")


Columns = dict[str, NDArray[Any]]


@dataclass(frozen=True, eq=False)
class Place:
    """The static surroundings of the actors.

    Attributes:
        roads: the lanes.
        ground: ground that actors are placed on.
        blocks: static obstacles in plan, parked vehicles included.
        obstacles: static obstacles of the scene, in 3D.
        parked: rows of the parked vehicles.
        region: the recorded region.
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
        """Return the surroundings made of a scene's obstacles and the parked vehicles."""
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
    """The table of actors of a simulation, and what was changed or left out.

    Attributes:
        actors: rows of the actors.
        outside: number of poses in the region left out because there is no ground below them.
        rigid: numbers of the trips whose vehicle is rigid although its trip has an articulated one.
        poses: delay of each trip at each step, stretch by stretch, as in `yielding.Before`; empty
            unless tracks are numbers of trips.
        absent: actors left out because they would overlap others; its rows are those before the
            removal.
        overlaps: remaining overlaps between actors, and with the scene.
    """

    actors: ActorRows
    outside: int
    rigid: frozenset[int]
    poses: tuple[Columns, ...]
    absent: Absent
    overlaps: dict[str, Any]


def actor_table(  # noqa: PLR0913 - all inputs of a drive
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
    scratch: Path | None = None,
    file: Path | None = None,
    tell: Progress = untold,
) -> Tabled:
    """Return the table of actors of a simulation.

    Tracks are numbered in the order of departure, followed by the further bodies of articulated
    vehicles.

    Args:
        simulated: SUMO's output.
        demand: the trips that it refers to.
        place: the static surroundings.
        steps: number of steps of the motion; steps before and after only shape the paths.
        step_s: time between steps, seconds.
        asset: returns an asset's dimensions and contacts by name.
        by_trip: number tracks by trip, whichever other actors are present.
        before: the same traffic up to the moment at which an event changes it.
        beside: actors whose presence or absence is fixed, whatever they overlap.
        scratch: folder for temporary files of long motions; ``None``: the system's.
        file: file for the rows of a long motion; ``None`` keeps them in memory.
        tell: called with the fraction done (0..1) and what is being done.
    """
    solids = _solids(simulated, demand, place)
    ground, lanes, shown = place.ground, simulated.lanes, simulated.signals
    hand_back_freed_memory()
    with _folder_for(len(simulated.step), scratch) as folder:
        paths = actor_ways(
            simulated, demand, place.roads, ground, place.blocks.low, solids,
            step_s=step_s, asset=asset, rigid=before.rigid if before else None, folder=folder,
            tell=between(tell, 0.0, _AFTER_SMOOTHING),
        )  # fmt: skip
        del simulated  # takes hundreds of megabytes for an hour of traffic
        hand_back_freed_memory()
        tell(_AFTER_SMOOTHING, "past each other")
        parting = Parted(
            paths, ground.levels(lanes), place.blocks, solids.shapes,
            place.roads.footway(0), step_s=step_s, asset=asset,
        )  # fmt: skip
        all_stretches = stretches(*paths.steps, step_s)
        lead = paths.who == vehicles(paths.who)
        left, outside, posed, poses = None, 0, 0, []
        stored = KeptRows(folder, place.region)
        rows_of = partial(
            actor_rows, trips=paths.trips, lanes=lanes, ground=ground, step_s=step_s, asset=asset
        )
        # Rows of one stretch are made while conflicts of the next are resolved.
        with ThreadPoolExecutor(1) as beside_it:
            made: list[Future[int]] = []
            for n, stretch in enumerate(all_stretches):
                share = (_AFTER_CONFLICTS - _AFTER_SMOOTHING) / len(all_stretches)
                telling = between(
                    tell, _AFTER_SMOOTHING + n * share, _AFTER_SMOOTHING + (n + 1) * share
                )
                crossings = Crossings.of(place.roads, lanes, shown, stretch.begin, stretch.seen)
                was = before.stretch(n) if before else None
                parted = parting.parted(stretch, left, was, crossings, telling)
                left = LeftOff.of(parted, stretch.end)
                if by_trip:
                    whose = lead[parted["trip"]]
                    poses.append({name: parted[name][whose] for name in ("trip", "step", "behind")})
                decided = (parted["step"] >= max(stretch.begin, 0)) & (
                    parted["step"] < min(stretch.end, steps)
                )
                shows = {name: parted[name][decided] for name in _TABLE_COLUMNS}
                outside += sum(rows_beside.result() for rows_beside in made)
                posed += len(shows["trip"])
                made = [beside_it.submit(stored.stood, shows, rows_of)]
                del parted, shows
            while wait(made, timeout=0.5).not_done:
                standing = between(tell, _AFTER_CONFLICTS, _AFTER_PLACING)
                standing(stored.taken / max(posed, 1), "standing on the ground")
            outside += sum(rows_beside.result() for rows_beside in made)
        whose = parting.vehicles.astype(np.int32)
        del parting
        hand_back_freed_memory()
        tell(_AFTER_PLACING, "looking for overlaps")
        trip = stored.trips()
        absent = absent_from(
            stored, whose[trip], vehicles(paths.who).astype(np.int32)[trip], place.parked,
            place.obstacles, place.region, step_s=step_s, beside=beside,
        )  # fmt: skip
        hand_back_freed_memory()
        tell(0.97, "looking for overlaps")
        number = paths.who if by_trip else None
        rows = stored.rows(trip, ~absent.rows, number, file if folder else None)
    overlaps = overlaps_told(absent.left, rows.parts(), place.parked)
    return Tabled(rows, outside, paths.rigid, tuple(poses), absent, overlaps)


@contextmanager
def _folder_for(rows: int, scratch: Path | None) -> Iterator[Path | None]:
    """Yield a temporary folder for a motion of many rows, ``None`` for one of few."""
    if rows <= _MAX_POSES_IN_MEMORY:
        yield None
        return
    with tempfile.TemporaryDirectory(prefix="rows-", dir=scratch) as name:
        yield Path(name)


def _solids(simulated: Simulated, demand: Demand, place: Place) -> Solids:
    """Return the outlines of obstacles near pedestrians' paths."""
    walks = np.array([trip.actor_class == "pedestrian" for trip in demand.trips], np.bool_)
    walked = simulated.front[walks[simulated.trip]] if len(walks) else np.zeros((0, 2))
    return Solids(place.blocks.low, walked, place.roads.footway(0))
