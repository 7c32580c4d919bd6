"""The traffic stage: from a twin to its motion."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from urbantwin.artefact import replaced_folder
from urbantwin.errors import InputError
from urbantwin.progress import Progress, between, untold
from urbantwin.result_warning import rows_of
from urbantwin.traffic.actor_table import Place, actor_table
from urbantwin.traffic.assets import OwnBodies
from urbantwin.traffic.demand.counted_report import arrivals
from urbantwin.traffic.demand.demand import Demand
from urbantwin.traffic.demand.site_demand import demand_of
from urbantwin.traffic.demand.time_of_day import at_time_of_day
from urbantwin.traffic.drive_manifest import manifest_of_drive
from urbantwin.traffic.events.elsewhere import moved, places_that_serve
from urbantwin.traffic.events.places import Spot
from urbantwin.traffic.events.put_in import StagedEvent, staged_table, with_events
from urbantwin.traffic.events.reacting import (
    REACTING,
    NotStagedError,
    changed_from,
    everybody,
    plan_events,
    reactions,
)
from urbantwin.traffic.events.scenario import PlacedEvent, scenario_events
from urbantwin.traffic.fingerprint import meshes_sha256, table_sha256
from urbantwin.traffic.fleet_of_twin import fleet_of, own_bodies
from urbantwin.traffic.freed_memory import hand_back_freed_memory
from urbantwin.traffic.motion import Motion
from urbantwin.traffic.motion_rows import ACTOR_SCHEMA, ActorRows, as_rows
from urbantwin.traffic.parked import ParkedVehicles, park
from urbantwin.traffic.paths.abreast import with_parties
from urbantwin.traffic.paths.absence import NOBODY, Absent, Bystanders
from urbantwin.traffic.paths.at_stops import with_passengers_at_stops
from urbantwin.traffic.paths.footing import on_footways
from urbantwin.traffic.paths.overlap import overlaps_of
from urbantwin.traffic.paths.placement import Ground
from urbantwin.traffic.paths.track_box import track_size
from urbantwin.traffic.paths.yielding import Before
from urbantwin.traffic.resize import resized
from urbantwin.traffic.result_warnings import warnings_of_drive
from urbantwin.traffic.signals import signal_table
from urbantwin.traffic.sumo.counted_signals import timing_told
from urbantwin.traffic.sumo.driven_net import driven_net
from urbantwin.traffic.sumo.run_ups import without_run_ups
from urbantwin.traffic.sumo.simulation import Simulated, simulate
from urbantwin.twin import Twin

__all__ = ["run_traffic", "with_more"]

#: Progress after which trips are planned, SUMO has finished, and the table is made.
_AFTER_PLANNING, _AFTER_SUMO, _AFTER_TABLE = 0.1, 0.42, 0.88


def run_traffic(
    twin: Twin,
    out: Path,
    *,
    seconds: float | None = None,
    seed: int | None = None,
    changes: Mapping[str, Any] | None = None,
    also: Callable[[Motion, Path], None] | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> Motion:
    """Simulate traffic in a twin and write the motion.

    The same twin, duration and seed give the same bytes.

    Args:
        twin: the twin; its site gives the traffic of each class.
        out: the folder to write.
        seconds: duration of the motion; ``None``: the site's ``traffic.duration_s``.
        seed: random seed; ``None``: the site's ``traffic.seed``.
        changes: fields that replace those of the site's ``traffic``.
        also: called with the motion and its folder before the folder appears, to add files such as
            pictures.
        progress: called with the fraction done and what is being done.

    Raises:
        InputError: the duration, the step or ``out`` cannot be used.
        StageError: SUMO failed, or the disk is full.
    """
    report = progress or untold
    settings = {**twin.site["traffic"], **(changes or {})}
    duration_s = settings["duration_s"] if seconds is None else seconds
    steps = _steps(duration_s, float(settings["step_s"]))
    chosen_seed = _seed(settings["seed"] if seed is None else seed)

    with replaced_folder(out, kind="motion", inputs=[twin.folder]) as folder:
        settings = at_time_of_day({**settings, "duration_s": duration_s, "seed": chosen_seed})
        motion = _driven(twin, settings, steps, folder, report)
        report(0.92, "writing the motion")
        motion.write(folder)
        if also is not None:
            report(0.94, "drawing the paths")
            also(motion, folder)
    report(1.0, "done")
    return motion


def _driven(
    twin: Twin,
    asked: Mapping[str, Any],
    steps: int,
    scratch: Path,
    told: Callable[[float, str], None],
) -> Motion:
    """Return the motion of a twin's traffic over ``steps`` steps."""
    told(0.0, "planning trips")
    demand = demand_of(
        twin,
        asked=asked,
        duration_s=steps * float(asked["step_s"]),
        seed=asked["seed"],
    )
    told(_AFTER_PLANNING / 2, "planning trips")
    net = driven_net(twin, asked, demand, steps * float(asked["step_s"]), scratch)
    roads, retimed = timing_told(net, twin.roads) if demand.counted else (twin.roads, {})
    streets = _Streets(twin, asked, steps, net, scratch, own_bodies(twin))
    scenario = list(enumerate(scenario_events(asked.get("scenario", ()))))
    reacting = [
        (n, event)
        for n, event in scenario
        if event.event in REACTING and isinstance(event, PlacedEvent)
    ]

    hand_back_freed_memory()
    tell = between(told, _AFTER_SUMO, _AFTER_TABLE, "actors")
    # SUMO runs in its own process: the static surroundings are prepared meanwhile.
    with ThreadPoolExecutor(1) as beside_it:
        surroundings = beside_it.submit(_parked_and_surroundings, twin, asked)
        beside_it.submit(_cache_asset_sizes, demand, streets.own)
        drive = streets.tabled(
            streets.drive(demand, between(told, _AFTER_PLANNING, _AFTER_SUMO)),
            demand, surroundings.result()[1], by_trip=bool(reacting), tell=tell,
        )  # fmt: skip
    parked, place = surroundings.result()
    if reacting:
        told(_AFTER_TABLE, "the same with events")
        drive = streets.with_reactions(drive, reacting, place)
    for made in scratch.glob("*.net.xml"):
        made.unlink()  # not part of the motion's folder
    step_s = float(asked["step_s"])
    shown = drive.simulated.signals
    signals = signal_table(shown, twin.roads.signals, steps=steps, step_s=step_s)
    manifest = manifest_of_drive(
        twin, asked, drive.demand, drive.simulated, drive.actors, roads, steps=steps
    )
    if retimed:
        manifest["signals_timed_for_counts"] = retimed
    manifest |= {
        "poses_outside_ground": drive.outside,
        "rigid_instead": len(drive.rigid),
        "absent": drive.absent.told,
        "parked": parked.notes,
    }
    if scenario:
        manifest["events"] = []
    driven = Motion(manifest, drive.actors, signals, streets.own.meshes, parked=place.parked)
    size = asked.get("size", {})
    staged, overlaps = drive.staged, None if size or scenario else drive.overlaps
    del drive  # takes hundreds of megabytes for an hour of traffic
    motion = resized(driven.with_meshes(between(told, _AFTER_TABLE, 0.91)), size)
    if scenario:
        motion = with_events(motion, twin, scenario, staged)
    told(0.91, "looking for overlaps")
    return _told(motion, twin, overlaps)


def with_more(twin: Twin, motion: Motion, told: Sequence[Mapping[str, Any]]) -> Motion:
    """Return a motion with events that only insert actors, as if driven with them.

    Args:
        twin: the motion's twin.
        motion: a motion without events.
        told: the events, in the form of ``traffic.scenario``, all of ``events.PUT_IN``.

    Raises:
        StageError: an event cannot be staged.
    """
    manifest = {**motion.manifest, "events": []}
    manifest["asked"] = {**manifest["asked"], "scenario": [dict(event) for event in told]}
    for name in ("overlaps", "warnings", "made"):
        manifest.pop(name, None)
    scenario = list(enumerate(scenario_events(told)))
    return _told(with_events(replace(motion, manifest=manifest), twin, scenario, ()), twin, None)


@dataclass(frozen=True, eq=False)
class _Drive:
    """The result of driving a demand.

    Attributes:
        demand: the planned trips.
        simulated: SUMO's output; of its positions only the `arrivals`.
        actors: rows of the actors.
        outside: number of poses in the region left out because there is no ground below them.
        rigid: trips with a rigid vehicle in place of an articulated one that would cut a corner
            into another actor.
        poses: delays of all trips, as in ``yielding.Before``.
        absent: actors left out because they would overlap others.
        overlaps: remaining overlaps; ``None`` if events changed the actors afterwards.
        staged: events that others reacted to.
    """

    demand: Demand
    simulated: Simulated
    actors: ActorRows
    outside: int
    rigid: frozenset[int]
    poses: tuple[dict[str, Any], ...]
    absent: Absent
    overlaps: dict[str, Any] | None
    staged: list[StagedEvent] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class _Streets:
    """The inputs of a drive: twin, network, duration and assets."""

    twin: Twin
    asked: Mapping[str, Any]
    steps: int
    net: Path
    scratch: Path
    own: OwnBodies

    @property
    def step_s(self) -> float:
        return float(self.asked["step_s"])

    def drive(
        self,
        demand: Demand,
        progress: Callable[[float, str], None] | None = None,
        staged: tuple[dict[str, Any], ...] = (),
    ) -> Simulated:
        """Simulate a demand in SUMO."""
        # Not bound to a name, so that SUMO's output is freed once parties are added.
        return with_parties(
            simulate(
                self.net,
                demand,
                self.own.asset,
                warmup_s=float(self.asked["warmup_s"]),
                steps=self.steps,
                step_s=self.step_s,
                seed=self.asked["seed"],
                staged=staged,
                roads=self.twin.roads,
                scratch=self.scratch,
                progress=progress,
            ),
            demand,
            self.twin.roads,
            self.step_s,
        )

    def _on_the_map(self, simulated: Simulated) -> Simulated:
        """Return SUMO's output without the extensions of roads beyond the map."""
        if self.net == self.twin.net_path:
            return simulated
        return without_run_ups(simulated, self.net, self.twin.roads)

    def tabled(
        self,
        simulated: Simulated,
        demand: Demand,
        place: Place,
        *,
        by_trip: bool,
        tell: Progress,
        before: Before | None = None,
        beside: Bystanders = NOBODY,
    ) -> _Drive:
        """Make the table of actors from SUMO's output."""
        hand_back_freed_memory()
        arrived = arrivals(simulated, demand)
        rows = [on_footways(self._on_the_map(simulated), demand, self.twin.roads)]
        del simulated
        rows += [
            with_passengers_at_stops(
                rows.pop(), demand, place.blocks.low, step_s=self.step_s, asset=self.own.asset
            )
        ]
        made = actor_table(
            rows.pop(),
            demand,
            place,
            steps=self.steps,
            step_s=self.step_s,
            asset=self.own.asset,
            by_trip=by_trip,
            before=before,
            beside=beside,
            scratch=self.scratch,
            file=None if by_trip else self.scratch / "actors.parquet",
            tell=tell,
        )
        return _Drive(demand, arrived, **vars(made))

    def with_reactions(
        self, without: _Drive, events: list[tuple[int, PlacedEvent]], place: Place
    ) -> _Drive:
        """Drive the same demand again with events that others react to, each at a feasible place.

        Raises:
            NotStagedError: an event cannot be staged at any of the places tried.
        """
        places = {
            n: places_that_serve(event, self.twin, without.actors.table()) for n, event in events
        }
        taken = dict.fromkeys(places, 0)
        while True:
            chosen = {n: places[n][taken[n]] for n in places}
            try:
                return self._with_reactions_at(chosen, without, events, place)
            except NotStagedError as error:
                taken[error.number] += 1
                tried = taken[error.number]
                if tried == len(places[error.number]):
                    elsewhere = f"; nor at {tried - 1} other places" if tried > 1 else ""
                    raise NotStagedError(f"{error}{elsewhere}", error.number) from None

    def _with_reactions_at(
        self,
        chosen: Mapping[int, tuple[Spot, Mapping[str, object]]],
        without: _Drive,
        events: list[tuple[int, PlacedEvent]],
        place: Place,
    ) -> _Drive:
        """Drive the same demand again with events at given places."""
        step_ms = round(self.step_s * 1000)
        start_s = math.ceil(float(self.asked["warmup_s"]) * 1000 / step_ms) * self.step_s
        placed = [(n, moved(event, chosen[n][0]) if chosen[n][1] else event) for n, event in events]
        plan = plan_events(placed, self.twin, without.demand, start_s)
        simulated = self.drive(without.demand, staged=plan.rows)
        requested = dict(events)
        reacted = [
            replace(
                reaction,
                event=requested[reaction.number],
                told={**reaction.told, **chosen[reaction.number][1]},
            )
            for reaction in reactions(simulated, placed, start_s, self.steps * self.step_s)
        ]
        demand = everybody(without.demand, plan)
        until = math.ceil(changed_from(events) / self.step_s - 1e-6)
        own = frozenset(trip for reaction in reacted for trip in reaction.trips)
        before = Before(without.poses, until, own, without.rigid)
        absent_steps = without.absent.steps
        for reaction in reacted:
            if (
                np.isin(absent_steps[:, 0], reaction.trips) & (absent_steps[:, 1] == until - 1)
            ).any():
                what = f"{reaction.event.event} at {reaction.event.at_s:g} s cannot be staged: "
                raise NotStagedError(what + "its actor is left out of the motion", reaction.number)
        drive = self.tabled(
            simulated, demand, place, by_trip=True, tell=untold, before=before,
            beside=Bystanders(own, until, absent_steps[absent_steps[:, 1] < until]),
        )  # fmt: skip
        actors, staged = staged_table(without.actors.table(), drive.actors.table(), reacted, events)
        return replace(drive, actors=as_rows(actors), overlaps=None, staged=staged)


def _cache_asset_sizes(demand: Demand, own: OwnBodies) -> None:
    """Compute and cache the sizes of all assets, which paths need later."""
    for name in {trip.asset for trip in demand.trips}:
        track_size(own.asset(name))


def _parked_and_surroundings(twin: Twin, asked: Mapping[str, Any]) -> tuple[ParkedVehicles, Place]:
    """Return the parked vehicles, and the surroundings including them."""
    ground = Ground(twin.ground_mesh, twin.roads)
    fleet = fleet_of(twin, asked["seed"])
    spaces = asked.get("parked", {})
    own = own_bodies(twin)
    parked = park(twin.roads, twin.mesh, ground, spaces, fleet=fleet, asset=own.asset)
    rows = parked.table(ACTOR_SCHEMA)
    return parked, Place.of(twin.roads, ground, twin.mesh, rows, twin.region)


def _told(motion: Motion, twin: Twin, overlaps: dict[str, Any] | None) -> Motion:
    """Return a motion whose manifest has overlaps, warnings and hashes of the results."""
    if overlaps is None:
        overlaps = overlaps_of(motion.rows, motion.parked, motion.step_s, twin.mesh)
    manifest = {**motion.manifest, "overlaps": overlaps}
    manifest["warnings"] = rows_of(warnings_of_drive(manifest))
    manifest["made"] = {
        "actors": table_sha256(motion.rows),
        "meshes": meshes_sha256(motion.meshes),
    }
    return replace(motion, manifest=manifest)


def _steps(duration_s: float, step_s: float) -> int:
    """Return the number of steps of a duration, at least one."""
    if not (np.isfinite(duration_s) and 0 < duration_s <= 86400):
        raise InputError(
            f"a duration of {duration_s:g} s", place="seconds", expected="0 to 86400 seconds"
        )
    return max(1, round(duration_s / step_s))


def _seed(seed: int) -> int:
    if not 0 <= seed < 2**31:
        raise InputError(f"a seed of {seed}", place="seed", expected="0 to 2147483647")
    return int(seed)
