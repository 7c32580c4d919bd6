"""The twin's traffic in CARLA's terms: how many of each class, as which blueprints, how fast."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree

from urbantwin.taxonomy import ACTOR_CLASSES
from urbantwin.traffic.demand.demand import Demand
from urbantwin.traffic.demand.site_demand import demand_of
from urbantwin.traffic.demand.vehicle_types import ACTOR_KINDS
from urbantwin.twin import Twin

__all__ = ["BLUEPRINTS", "carla_traffic"]

#: Class of actors -> blueprints of CARLA 0.9.16: a pattern of ``BlueprintLibrary.filter``, the
#: value of the attribute ``base_type``, and blueprints of that type that are another class of ours
#: or that a street rarely sees (https://carla.readthedocs.io/en/0.9.16/catalogue_vehicles/).
BLUEPRINTS: dict[str, dict[str, Any]] = {
    "car": {
        "filter": "vehicle.*",
        "base_type": ["car"],
        "except": ["vehicle.*police*", "vehicle.ford.ambulance", "vehicle.micro.microlino"],
    },
    "van": {
        "filter": "vehicle.*",
        "base_type": ["van"],
        "except": ["vehicle.ford.ambulance"],
    },
    "truck": {
        "filter": "vehicle.*",
        "base_type": ["truck"],
        "except": ["vehicle.carlamotors.firetruck", "vehicle.tesla.cybertruck"],
    },
    "bus": {"filter": "vehicle.*", "base_type": ["bus"], "except": []},
    "motorcycle": {"filter": "vehicle.*", "base_type": ["motorcycle"], "except": []},
    "bicycle": {"filter": "vehicle.*", "base_type": ["bicycle"], "except": []},
    "pedestrian": {"filter": "walker.pedestrian.*", "base_type": [], "except": []},
    "tram": {"filter": "", "base_type": [], "except": []},  # CARLA has none
    "trailer": {"filter": "", "base_type": [], "except": []},
    "animal": {"filter": "", "base_type": [], "except": []},
}
_NORMC = re.compile(r"normc\(([-\d.,\s]+)\)")


def carla_traffic(twin: Twin, scratch: Path | None = None) -> dict[str, Any]:
    """Return what reproduces the twin's mix of traffic, for a client of CARLA.

    ``per_hour`` is the flow that the site asks for. ``population`` is how many of a class are on
    the streets at a time: in a closed loop those who circulate, elsewhere flow times the mean time
    to drive the planned routes freely (Little's law; ``mean_travel_s`` is that time, or in a loop
    the time for a way round). ``speed_factor`` is that of SUMO's vehicle types: mean, deviation,
    least and greatest share of the speed limit, of which CARLA's Traffic Manager takes the
    difference in percent; pedestrians and cyclists have ``speed_ms`` instead, what they want to go
    at.

    Args:
        twin: the twin.
        scratch: a folder for SUMO's files; the system's when not given.
    """
    asked = twin.site["traffic"]
    per_hour: Mapping[str, float] = asked["per_hour"]
    seed = int(asked["seed"])
    demand = demand_of(twin, duration_s=float(asked["duration_s"]), seed=seed, metered=False)
    if demand.circulates:
        present = Counter(trip.actor_class for trip in demand.trips)
        seconds = {
            name: 3600.0 * count / max(float(per_hour[name]), 1e-9)
            for name, count in present.items()
        }
    else:
        seconds = _mean_seconds(demand, _edge_seconds(twin))
        present = Counter(
            {name: max(1, round(per_hour[name] * t / 3600.0)) for name, t in seconds.items()}
        )
    classes = {}
    for name in ACTOR_CLASSES:
        flow = float(per_hour.get(name, 0.0))
        if flow <= 0.0 or name not in seconds:
            continue
        classes[name] = {
            "per_hour": flow,
            "population": present[name],
            "mean_travel_s": round(seconds[name], 1),
            "blueprints": BLUEPRINTS[name],
            **_speed(name),
        }
    return {
        "kind": "carla traffic",
        "map": "",
        "driving_side": twin.roads.driving_side,
        "seed": seed,
        "step_s": float(asked["step_s"]),
        "warmup_s": float(asked["warmup_s"]),
        "duration_s": float(asked["duration_s"]),
        "classes": classes,
        "left_out": [{"class": one.actor_class, "why": one.why} for one in demand.left_out],
    }


def _speed(name: str) -> dict[str, Any]:
    """Return how fast a class wants to go."""
    parameters = ACTOR_KINDS[name].parameters
    found = _NORMC.match(parameters.get("speedFactor", ""))
    keys = ("mean", "deviation", "least", "greatest")
    factor = {"mean": 1.0, "deviation": 0.1, "least": 0.2, "greatest": 2.0}  # SUMO's defaults
    if found:
        factor = dict(zip(keys, map(float, found[1].split(",")), strict=True))
    wanted = parameters.get("desiredMaxSpeed")
    if wanted:
        return {"speed_ms": float(wanted), "speed_factor": factor}
    limit = {"tm_speed_difference_percent": round(100.0 * (1.0 - factor["mean"]), 1)}
    return {"speed_factor": factor, **limit}


def _edge_seconds(twin: Twin) -> dict[str, tuple[float, float]]:
    """Return length, metres, and speed limit, m/s, of each edge of the SUMO network."""
    found = {}
    for edge in etree.parse(twin.net_path).getroot().iterfind("edge"):
        lanes = edge.findall("lane")
        if lanes:
            limit = max(float(lane.get("speed")) for lane in lanes)
            found[edge.get("id")] = (float(lanes[0].get("length")), limit)
    return found


def _mean_seconds(demand: Demand, edges: Mapping[str, tuple[float, float]]) -> dict[str, float]:
    """Return the mean time of each class's trips at free speed."""
    times: dict[str, list[float]] = {}
    for trip in demand.trips:
        wanted = ACTOR_KINDS[trip.actor_class].parameters.get("desiredMaxSpeed")
        most = float(wanted) if wanted else np.inf
        total = sum(
            edges[name][0] / min(edges[name][1], most) for name in trip.edges if name in edges
        )
        times.setdefault(trip.actor_class, []).append(total)
    return {name: float(np.mean(values)) for name, values in times.items()}
