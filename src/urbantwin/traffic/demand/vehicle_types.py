"""SUMO's vehicle class and type of each class of actors, where not SUMO's defaults."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from urbantwin.roads.curve_speed import SIDEWAYS_MS2
from urbantwin.taxonomy import ACTOR_CLASSES

__all__ = ["ACTOR_KINDS", "GAP_SPREAD", "IN_BENDS", "IN_QUEUES", "ActorKind", "manners_of"]

#: Parameter (not attribute) of a vehicle type: standard deviation of the gaps at standstill,
#: metres.
GAP_SPREAD = "urbantwin.standing_gap_spread"


@dataclass(frozen=True)
class ActorKind:
    """A class of actors in SUMO's terms.

    Attributes:
        vclass: SUMO's vehicle class, which determines where the actor may go.
        parameters: attributes of the SUMO vehicle type. Others keep SUMO's defaults for the vehicle
            class (https://sumo.dlr.de/docs/Vehicle_Type_Parameter_Defaults.html).
    """

    vclass: str
    parameters: Mapping[str, str] = field(default_factory=dict)


# Desired speeds scatter about the limit and are cut at 1.2 of it. Two-wheelers do not keep to the
# centre of the lane: bicycles ride on the kerb's side, motorcycles wherever there is room. Lateral
# speed is at most a quarter of the longitudinal speed, so that nothing slides sideways.
_STEERING = {"lcMaxSpeedLatStanding": "0", "lcMaxSpeedLatFactor": "0.25"}
_DRIVER = {
    "speedFactor": "normc(1.00,0.10,0.70,1.20)",
    "sigma": "0.3",
    # Queues then discharge at 1,900 cars per hour of green (HCM 2016, 19: the base rate).
    "tau": "1.35",
    "minGapLat": "0.4",
    # Standard deviation of 0.3 of the mean. LUMPI, frames 1 to 12: 34 gaps with a median of 2.5 m,
    # 10th to 90th percentile 1.5 to 3.4 m.
    GAP_SPREAD: "0.6",
    # Where a lane becomes several equally good ones, not all vehicles take the rightmost.
    "lcContRight": "0.5",
    # Time after which a vehicle drives on although there is no room beyond a junction, seconds.
    "jmIgnoreKeepClearTime": "60",
    **_STEERING,
}
_HEAVY = {**_DRIVER, "speedFactor": "normc(0.93,0.05,0.70,1.05)"}

_CAR = {**_DRIVER, "minGap": "2.0", "latAlignment": "center"}

ACTOR_KINDS: dict[str, ActorKind] = {
    "car": ActorKind("passenger", _CAR),
    "truck": ActorKind("truck", {**_HEAVY, "latAlignment": "center"}),
    "bus": ActorKind("bus", {**_HEAVY, "latAlignment": "center"}),
    "motorcycle": ActorKind(
        "motorcycle",
        {
            **_DRIVER,
            "tau": "1.0",
            "accel": "3.5",
            "decel": "4.5",
            "minGap": "1.5",
            "minGapLat": "0.3",
            "latAlignment": "nice",
        },
    ),
    # Free-riding bicycles: mean 5.0 m/s (Parkin and Rotheram, Transport Policy 17, 2010).
    "bicycle": ActorKind(
        "bicycle",
        {
            "maxSpeed": "6.5",
            "desiredMaxSpeed": "5.0",
            "speedFactor": "normc(1.00,0.15,0.60,1.30)",
            "minGap": "0.8",
            "minGapLat": "0.3",
            "latAlignment": "right",
            **_STEERING,
        },
    ),
    # Free walking: mean 1.34 m/s, standard deviation 0.26 (Weidmann, ETH IVT 90, 1993).
    "pedestrian": ActorKind(
        "pedestrian", {"desiredMaxSpeed": "1.34", "speedFactor": "normc(1.00,0.19,0.50,1.60)"}
    ),
    "van": ActorKind("passenger", _CAR),
    # Starting and service braking of trams in streets, m/s2; with magnetic brakes they reach 2.7
    # (BOStrab, braking guidelines).
    "tram": ActorKind(
        "tram",
        {
            "accel": "1.0",
            "decel": "1.2",
            "emergencyDecel": "2.7",
            "speedFactor": "1",
            "minGap": "3.0",
            "latAlignment": "center",
            **_STEERING,
        },
    ),
    # Part of another actor, which SUMO simulates as a whole.
    "trailer": ActorKind("trailer"),
    "animal": ActorKind("pedestrian"),
}
assert tuple(ACTOR_KINDS) == ACTOR_CLASSES


_ACCELERATION = "2.6"  # SUMO's default for cars
#: Parameters (not attributes) of a vehicle type: factor on the usual speed in curves, which
#: ``curves`` reads, and headway when leaving a queue, which ``queue_headway`` reads.
IN_BENDS, IN_QUEUES = "urbantwin.in_bends", "urbantwin.queue_headway"
#: Field of ``traffic.drivers`` -> SUMO's attribute.
_ATTRIBUTES = {
    "headway_s": "tau",
    "standing_gap_m": "minGap",
    "standing_gap_spread_m": GAP_SPREAD,
    "acceleration": "accel",
    "critical_gap_s": "jmTimegapMinor",
    "queue_headway_s": IN_QUEUES,
    "lane_offset_m": "latAlignment",
}
_ACCELERATION_SPEEDS_MS, _MIN_ACCELERATION_MS2 = (0.0, 10.0, 20.0, 30.0), 0.3
#: Cut of desired speeds, standard deviations from their mean.
_MAX_SPEED_SIGMAS = 2.5


def manners_of(drivers: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, str]]:
    """Return, by class, the attributes of SUMO's vehicle type that a site changes.

    Args:
        drivers: ``traffic.drivers`` of the site.
    """
    attributes: dict[str, dict[str, str]] = {}
    for name, driver in drivers.items():
        values = {
            attribute: f"{driver[field]:g}"
            for field, attribute in _ATTRIBUTES.items()
            if driver.get(field) is not None
        }
        if driver.get("speed_factor") is not None or driver.get("speed_spread") is not None:
            mean, spread = _usual(name)
            mean = mean if driver.get("speed_factor") is None else driver["speed_factor"]
            spread = spread if driver.get("speed_spread") is None else driver["speed_spread"]
            low, high = (
                max(mean - _MAX_SPEED_SIGMAS * spread, 0.1),
                mean + _MAX_SPEED_SIGMAS * spread,
            )
            values["speedFactor"] = f"normc({mean:.3f},{spread:.3f},{low:.3f},{high:.3f})"
        if driver.get("acceleration_at_10") is not None:
            most = driver.get("acceleration")
            most = float(_parameter(name, "accel", _ACCELERATION)) if most is None else most
            fall = (most - min(driver["acceleration_at_10"], most)) / 10.0
            left = [
                f"{max(most - fall * speed, _MIN_ACCELERATION_MS2):.3f}"
                for speed in _ACCELERATION_SPEEDS_MS
            ]
            values["speedTable"] = " ".join(f"{speed:g}" for speed in _ACCELERATION_SPEEDS_MS)
            values["maxAccelProfile"] = " ".join(left)
        if driver.get("sideways_acceleration") is not None:
            values[IN_BENDS] = f"{(driver['sideways_acceleration'] / SIDEWAYS_MS2) ** 0.5:.3f}"
        attributes[name] = values
    return attributes


def _usual(name: str) -> tuple[float, float]:
    """Return mean and standard deviation of the usual speed factor of a class."""
    text = _parameter(name, "speedFactor", "normc(1,0.1,0.2,2)")
    mean, spread = text.removeprefix("normc(").rstrip(")").split(",")[:2]
    return float(mean), float(spread)


def _parameter(name: str, attribute: str, otherwise: str) -> str:
    return ACTOR_KINDS[name].parameters.get(attribute, otherwise)
