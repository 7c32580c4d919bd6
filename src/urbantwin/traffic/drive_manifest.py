"""The manifest of a drive (``motion.json``): traffic requested, driven and seen, and problems."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

from urbantwin import __version__
from urbantwin.roads import RoadNetwork
from urbantwin.taxonomy import ACTOR_CLASSES
from urbantwin.traffic.assets import AssetName, asset_names, bodies_of_asset, class_of
from urbantwin.traffic.demand.counted_report import counted_report
from urbantwin.traffic.demand.demand import Demand
from urbantwin.traffic.flow.circulation_report import circulation_report
from urbantwin.traffic.flow.past_sensors import traffic_past_sensors
from urbantwin.traffic.motion import MOTION_VERSION
from urbantwin.traffic.motion_rows import ActorRows
from urbantwin.traffic.sumo.simulation import Simulated
from urbantwin.twin import Twin

__all__ = ["manifest_of_drive"]

#: Maximum number of collisions listed individually.
_MAX_LISTED = 20


def manifest_of_drive(
    twin: Twin,
    asked: Mapping[str, Any],
    demand: Demand,
    simulated: Simulated,
    actors: ActorRows,
    roads: RoadNetwork,
    *,
    steps: int,
) -> dict[str, Any]:
    """Return the part of a motion's manifest that describes the drive.

    Args:
        twin: the twin.
        asked: ``traffic`` of the site, as requested.
        demand: the planned trips.
        simulated: SUMO's output.
        actors: rows of the motion.
        roads: the lanes, with the signal programs used.
        steps: number of steps of the motion.
    """
    step_s, warmup_s = float(asked["step_s"]), float(asked["warmup_s"])
    manifest: dict[str, Any] = {
        "kind": "motion",
        "version": MOTION_VERSION,
        "urbantwin": __version__,
        "twin_sha256": twin.sha256,
        "asked": dict(asked),
        "sumo": simulated.sumo,
        "seed": asked["seed"],
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
        "collided": [
            _collision_row(*collision, demand=demand)
            for collision in simulated.collided[:_MAX_LISTED]
        ],
    }
    if demand.counted:
        manifest["counts"] = counted_report(
            asked["counts"],
            asked["per_hour"],
            demand,
            simulated,
            roads,
            steps=steps,
            step_s=step_s,
        )
    if demand.circulates:
        manifest["circulation"] = circulation_report(demand, simulated, warmup_s, roads)
    manifest["past_sensors"] = traffic_past_sensors(
        twin, demand, actors, planned_s=warmup_s + steps * step_s, steps=steps
    )
    if demand.passengers.places:
        manifest["passengers"] = _passengers(demand, simulated, steps * step_s)
    return manifest


def _passengers(demand: Demand, simulated: Simulated, duration_s: float) -> list[dict[str, Any]]:
    """Return the passengers of each stop with waiting people: waiting, boarding and alighting."""
    rows = []
    for place in demand.passengers.places:
        own = [row for row in simulated.boarded if row[3] == place.stop]
        seen = Counter(row[1] for row in own if 0.0 <= row[0] < duration_s)
        before = Counter(row[1] for row in own if row[0] < 0.0)
        rows.append(
            {
                "stop": demand.stops[place.stop].name,
                "of": place.kind,
                "x": round(float(place.point[0]), 2),
                "y": round(float(place.point[1]), 2),
                "waiting_at_start": before["waits"] - before["boards"],
                "came": seen["waits"],
                "got_on": seen["boards"],
                "got_off": seen["alights"],
            }
        )
    return rows


def _counts(
    per_hour: Mapping[str, float], demand: Demand, simulated: Simulated, actors: ActorRows
) -> dict[str, dict[str, float | int]]:
    """Return, for each class, the numbers of actors requested, driven, and seen in the motion."""
    tracks = actors.distinct(["track", "class", "asset"])
    towed_bodies = {
        body.asset
        for kind in ACTOR_CLASSES
        for name in asset_names(kind)
        for body in bodies_of_asset(name)[1:]
        if class_of(body.asset) == kind
    }
    shown = zip(tracks["class"].to_pylist(), tracks["asset"].to_pylist(), strict=True)
    seen = Counter(kind for kind, name in shown if AssetName.of(name).body not in towed_bodies)
    left_out = {item.actor_class: item.count for item in demand.left_out}
    counts: dict[str, dict[str, float | int]] = {}
    for name in ACTOR_CLASSES:
        trips = {
            n
            for n, trip in enumerate(demand.trips)
            if trip.actor_class == name and (n in simulated.departed or not trip.in_reserve)
        }
        counts[name] = {
            "per_hour": float(per_hour.get(name, 0.0)),
            "asked": len(trips) + left_out.get(name, 0),
            "driven": len(trips & simulated.departed),
            "seen": seen[name],
        }
    return counts


def _collision_row(
    time_s: float, x: float, y: float, lane: str, *pair: str, demand: Demand
) -> dict[str, Any]:
    """Return an entry of a collision that SUMO reported: assets, first time, place and lane."""
    assets = {str(number): trip.asset for number, trip in enumerate(demand.trips)}
    involved = [assets.get(name, name) for name in pair]
    place = {"x": round(x, 1), "y": round(y, 1), "lane": lane}
    return {"who": involved, "time_s": round(time_s, 3), **place}
