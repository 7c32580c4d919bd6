"""The traffic stage: from a twin to its motion."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from urbantwin import __version__
from urbantwin.artefact import replaced_folder
from urbantwin.errors import InputError
from urbantwin.progress import Progress, between, untold
from urbantwin.result_warning import rows_of
from urbantwin.roads.assignment.movement_flows import IN_CARS
from urbantwin.roads.assignment.street_network import StreetNetwork
from urbantwin.site.country import country_of
from urbantwin.site.traffic import OwnAssetSpec
from urbantwin.taxonomy import ACTOR_CLASSES
from urbantwin.traffic.actor_table import Place, actor_table
from urbantwin.traffic.assets import Fleet, OwnBodies, asset, asset_names
from urbantwin.traffic.demand.circulation import Circulation
from urbantwin.traffic.demand.counts import counted_demand, counted_report, is_counted
from urbantwin.traffic.demand.demand import Demand, plan_demand, together
from urbantwin.traffic.demand.guessed_volumes import Bound, bound_of_signals
from urbantwin.traffic.demand.manners import manners_of
from urbantwin.traffic.events.put_in import StagedEvent, staged_table, with_events
from urbantwin.traffic.events.reacting import (
    REACTING,
    Reaction,
    changed_from,
    everybody,
    plan_events,
    reactions,
)
from urbantwin.traffic.events.scenario import Event, scenario_events
from urbantwin.traffic.fingerprint import meshes_sha256, table_sha256
from urbantwin.traffic.flow.bottleneck import bottleneck
from urbantwin.traffic.flow.circulation_report import circulation_report
from urbantwin.traffic.flow.flow_calibration import calibrate
from urbantwin.traffic.motion import ACTOR_SCHEMA, MOTION_VERSION, Motion
from urbantwin.traffic.parked import park
from urbantwin.traffic.paths.footing import on_footways
from urbantwin.traffic.paths.overlap import overlaps_of
from urbantwin.traffic.paths.placement import Ground
from urbantwin.traffic.paths.yielding import Before
from urbantwin.traffic.resize import resized
from urbantwin.traffic.result_warnings import warnings_of_drive
from urbantwin.traffic.signals import signal_table
from urbantwin.traffic.sumo.signal_offset import net_with_offsets
from urbantwin.traffic.sumo.simulation import Simulated, simulate
from urbantwin.twin import Twin

__all__ = ["demand_of", "outer_roads", "own_bodies", "run_traffic"]

#: Length of road that a standing car takes, with the gap before it, metres.
CAR_SPACE_M = 7.0


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
        twin: the twin; its site says how much traffic of each class.
        out: the folder to write.
        seconds: how long the motion is; ``None`` for the site's ``traffic.duration_s``.
        seed: of every random choice; ``None`` for the site's ``traffic.seed``.
        changes: fields of the site's ``traffic`` that are to be others.
        also: given the motion and its folder before it appears, for what else belongs into it:
            pictures.
        progress: called with the fraction done and what is being done.

    Raises:
        InputError: the duration, the step or ``out`` cannot be used.
        StageError: SUMO failed, or the disk is full.
    """
    told = progress or untold
    asked = {**twin.site["traffic"], **(changes or {})}
    duration_s = asked["duration_s"] if seconds is None else seconds
    steps = _steps(duration_s, float(asked["step_s"]))
    chosen_seed = _seed(asked["seed"] if seed is None else seed)

    with replaced_folder(out, kind="motion", inputs=[twin.folder]) as folder:
        asked = {**asked, "duration_s": duration_s, "seed": chosen_seed}
        motion = _driven(twin, asked, steps, folder, told)
        told(0.95, "writing the motion")
        motion.write(folder)
        if also is not None:
            told(0.97, "drawing the paths")
            also(motion, folder)
    told(1.0, "done")
    return motion


def _driven(
    twin: Twin,
    asked: Mapping[str, Any],
    steps: int,
    scratch: Path,
    told: Callable[[float, str], None],
) -> Motion:
    """Return the motion of ``steps`` steps that a twin's traffic makes."""
    step_s, warmup_s, seed = float(asked["step_s"]), float(asked["warmup_s"]), asked["seed"]
    own = own_bodies(twin)
    told(0.0, "planning trips")
    demand = demand_of(
        twin,
        asked=asked,
        duration_s=steps * step_s,
        seed=seed,
        scratch=scratch,
        progress=lambda fraction: told(0.1 * fraction, "finding how many circulate"),
    )
    net_path, offsets = twin.net_path, asked.get("signal_offsets")
    if offsets:
        net_path = net_with_offsets(net_path, offsets, scratch / "offset.net.xml")
    drive = partial(
        simulate,
        net_path,
        demand,
        own.asset,
        warmup_s=warmup_s,
        steps=steps,
        step_s=step_s,
        seed=seed,
        roads=twin.roads,
        scratch=scratch,
    )
    simulated = drive(progress=lambda fraction, what: told(0.1 + 0.5 * fraction, what))
    told(0.6, "actors")
    ground = Ground(twin.ground_mesh, twin.roads)
    parked = park(
        twin.roads,
        twin.mesh,
        ground,
        asked.get("parked", {}),
        fleet=Fleet(country_of(*_anchor(twin)), seed, own),
        asset=own.asset,
    )
    standing = parked.table(ACTOR_SCHEMA)
    standing_among = Place.of(twin.roads, ground, twin.mesh, standing)
    scenario = list(enumerate(scenario_events(asked.get("scenario", ()))))
    reacting = [(n, one) for n, one in scenario if one.event in REACTING]

    def tabled(
        seen: Simulated, whose: Demand, tell: Progress, before: Before | None = None
    ) -> tuple[pa.Table, int, dict[str, Any]]:
        return actor_table(
            on_footways(seen, whose, twin.roads),
            whose,
            standing_among,
            steps=steps,
            step_s=step_s,
            asset=own.asset,
            by_trip=bool(reacting),
            before=before,
            tell=tell,
        )

    actors, outside, poses = tabled(simulated, demand, between(told, 0.6, 0.85, "actors"))
    staged: list[StagedEvent] = []
    if reacting:
        told(0.85, "the same with events")
        start_s = math.ceil(warmup_s * 1000 / round(step_s * 1000)) * step_s
        plan = plan_events(reacting, twin, demand, start_s)
        simulated = drive(staged=plan.rows)
        demand = everybody(demand, plan)
        became = reactions(simulated, reacting, start_s, steps * step_s)
        with_them, outside, _ = tabled(
            simulated, demand, untold, _before(poses, reacting, became, step_s)
        )
        actors, staged = staged_table(actors, with_them, became, reacting)
    if offsets:
        net_path.unlink()  # the folder is the motion's
    signals = signal_table(simulated.signals, twin.roads.signals, steps=steps, step_s=step_s)
    manifest = {
        "kind": "motion",
        "version": MOTION_VERSION,
        "urbantwin": __version__,
        "twin_sha256": twin.sha256,
        "asked": dict(asked),
        "sumo": simulated.sumo,
        "seed": seed,
        "step_s": step_s,
        "steps": steps,
        "duration_s": round(steps * step_s, 9),
        "warmup_s": warmup_s,
        "classes": _counts(asked["per_hour"], demand, simulated, actors),
        "left_out": [
            {"class": item.actor_class, "count": item.count, "why": item.why}
            for item in demand.left_out
        ],
        "teleports": simulated.teleports,
        "collisions": simulated.collisions,
        "poses_outside_ground": outside,
    }
    if demand.counted:
        manifest["counts"] = counted_report(
            asked["counts"], asked["per_hour"], demand, simulated, steps=steps, step_s=step_s
        )
    if demand.circulates:
        manifest["circulation"] = circulation_report(demand, simulated.observed, warmup_s)
    if scenario:
        manifest["events"] = []
    manifest["parked"] = parked.notes
    driven = Motion(manifest, actors, signals, own.meshes, parked=standing)
    shown = driven.with_meshes(between(told, 0.85, 0.93))
    motion = resized(shown, asked.get("size", {}))
    if scenario:
        motion = with_events(motion, twin, scenario, staged)
    told(0.93, "who passes through whom")
    overlaps = overlaps_of(motion.actors, motion.parked, step_s, twin.mesh)
    manifest = {**motion.manifest, "overlaps": overlaps}
    manifest["warnings"] = rows_of(warnings_of_drive(manifest))
    made = {"actors": table_sha256(motion.actors), "meshes": meshes_sha256(motion.meshes)}
    return replace(motion, manifest={**manifest, "made": made})


def _before(
    poses: dict[str, Any],
    events: Sequence[tuple[int, Event]],
    became: Sequence[Reaction],
    step_s: float,
) -> Before:
    """Return how traffic went until its first event, and who does as the events say."""
    until = math.ceil(changed_from(events) / step_s - 1e-6)
    return Before(poses, until, frozenset(trip for one in became for trip in one.trips))


def demand_of(
    twin: Twin,
    *,
    duration_s: float,
    seed: int,
    asked: Mapping[str, Any] | None = None,
    scratch: Path | None = None,
    progress: Callable[[float], None] | None = None,
) -> Demand:
    """Return who sets out in a twin, as its site (or ``asked``) wants, over warm-up and duration.

    In a closed loop everybody comes in during the warm-up and stays. How many that takes is found
    by pilot simulations (``flow_calibration``). Elsewhere traffic passes through.

    Raises:
        StageError: SUMO failed.
    """
    asked = asked or twin.site["traffic"]
    manners = manners_of(asked.get("drivers", {}))
    own = own_bodies(twin)
    body = Fleet(country_of(*_anchor(twin)), seed, own).body
    if asked.get("counts"):
        return replace(_counted(twin, asked, duration_s, seed, body), manners=manners)
    network = StreetNetwork(twin.net_path, twin.region)
    circulation, bound = None, Bound()
    if twin.site.get("closed_loop"):
        circulation = Circulation(
            network,
            outer_roads(twin),
            asked["per_hour"],
            seed,
            stops=(*twin.roads.stops, *twin.roads.tram_stops),
            bus_roads=frozenset(twin.roads.bus_roads),
        )
        if asked.get("guessed"):
            bound = bound_of_signals(twin.net_path, circulation.flows())
            circulation.per_hour = bound.of(circulation.per_hour, IN_CARS)
    if circulation is not None and circulation.drives:
        found = calibrate(
            circulation,
            twin.net_path,
            roads=twin.roads,
            room=_room(twin),
            asset=own.asset,
            body=body,
            scratch=scratch,
            progress=progress,
        )
        demand = circulation.demand(
            found.populations,
            warmup_s=float(asked["warmup_s"]),
            duration_s=duration_s,
            body=body,
        )
        held_up = bottleneck(twin.roads, found.standing) if found.carried < 1 else ""
        return replace(demand, carried=found.carried, held_up=held_up, bound=bound, manners=manners)
    planned = plan_demand(
        network,
        asked["per_hour"],
        warmup_s=float(asked["warmup_s"]),
        duration_s=duration_s,
        seed=seed,
        body=body,
    )
    return replace(planned, manners=manners)


def _counted(
    twin: Twin,
    asked: Mapping[str, Any],
    duration_s: float,
    seed: int,
    body: Callable[[str, int], str],
) -> Demand:
    """Return the demand of a site that has counts: everybody passes through."""
    outer = outer_roads(twin) if twin.site.get("closed_loop") else frozenset()
    network = StreetNetwork(twin.net_path, twin.region, without=outer)
    counts, per_hour = asked["counts"], asked["per_hour"]
    warmup_s = float(asked["warmup_s"])
    counted = counted_demand(
        counts,
        twin.roads,
        network,
        per_hour,
        warmup_s=warmup_s,
        duration_s=duration_s,
        seed=seed,
        body=body,
    )
    others = plan_demand(
        network,
        {name: rate for name, rate in per_hour.items() if not is_counted(name, counts)},
        warmup_s=warmup_s,
        duration_s=duration_s,
        seed=seed,
        body=body,
    )
    return together(counted, others)


def own_bodies(twin: Twin) -> OwnBodies:
    """Return the bodies that a twin's site brings along."""
    told = [OwnAssetSpec.model_validate(one) for one in twin.site["traffic"].get("assets", ())]
    return OwnBodies(
        {one.name: one.actor_class for one in told},
        {one.name: one.share for one in told},
        {(name, 0): mesh for name, mesh in twin.own_meshes.items()},
    )


def _anchor(twin: Twin) -> tuple[float, float]:
    anchor = twin.manifest["anchor"]
    return float(anchor["latitude"]), float(anchor["longitude"])


def outer_roads(twin: Twin) -> frozenset[str]:
    """Return the edges of outer roads, which no way of the map is, and of outer tracks.

    Roads that are not made from ways have none: there one turns round where they end.
    """
    roads = twin.roads.roads
    rails = frozenset(track.id for track in twin.roads.tracks if track.outer)
    if not any(road.ways for road in roads):
        return rails
    return rails | frozenset(road.id for road in roads if not road.ways)


def _room(twin: Twin) -> float:
    """Return how many cars fit onto the lanes bumper to bumper."""
    lanes = (lane for lane in twin.roads.lanes if lane.road and "car" in lane.allowed)
    return sum(lane.length for lane in lanes) / CAR_SPACE_M


def _steps(duration_s: float, step_s: float) -> int:
    """Return how many steps a motion of a duration has, one at least."""
    if not (np.isfinite(duration_s) and 0 < duration_s <= 86400):
        raise InputError(
            f"a duration of {duration_s:g} s", place="seconds", expected="0 to 86400 seconds"
        )
    return max(1, round(duration_s / step_s))


def _seed(seed: int) -> int:
    if not 0 <= seed < 2**31:
        raise InputError(f"a seed of {seed}", place="seed", expected="0 to 2147483647")
    return int(seed)


def _counts(
    per_hour: Mapping[str, float], demand: Demand, simulated: Simulated, actors: pa.Table
) -> dict[str, dict[str, float | int]]:
    """Return, for each class, how many were asked for, came in, and are seen in the motion."""
    tracks = actors.group_by(["track", "class", "asset"]).aggregate([])
    behind = {body.asset for name in asset_names("tram") for body in asset(name).bodies[1:]}
    shown = zip(tracks["class"].to_pylist(), tracks["asset"].to_pylist(), strict=True)
    seen = Counter(kind for kind, name in shown if name not in behind)
    left_out = {item.actor_class: item.count for item in demand.left_out}
    counts: dict[str, dict[str, float | int]] = {}
    for name in ACTOR_CLASSES:
        trips = {n for n, trip in enumerate(demand.trips) if trip.actor_class == name}
        counts[name] = {
            "per_hour": float(per_hour.get(name, 0.0)),
            "asked": len(trips) + left_out.get(name, 0),
            "driven": len(trips & simulated.departed),
            "seen": seen[name],
        }
    return counts
