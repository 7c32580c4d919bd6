"""How drivers drive, as attributes and parameters of SUMO's vehicle types."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from urbantwin.roads.curve_speed import SIDEWAYS_MS2
from urbantwin.traffic.demand.vehicle_types import ACTOR_KINDS, GAP_SPREAD

__all__ = ["IN_BENDS", "IN_QUEUES", "manners_of"]

_ACCELERATION = "2.6"  # SUMO's for cars
#: Parameters (no attributes) of a vehicle type: its speed in bends, against what is usual, which
#: ``curves`` reads, and its headway when it stands, which ``queue_headway`` reads.
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
_FADES_MS, _LEAST_MS2 = (0.0, 10.0, 20.0, 30.0), 0.3
#: Desired speeds are cut so many standard deviations from their mean.
_CUT = 2.5


def manners_of(drivers: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, str]]:
    """Return by class the attributes of SUMO's vehicle type that a site changes.

    Args:
        drivers: ``traffic.drivers`` of the site.
    """
    found: dict[str, dict[str, str]] = {}
    for name, one in drivers.items():
        values = {
            attribute: f"{one[field]:g}"
            for field, attribute in _ATTRIBUTES.items()
            if one.get(field) is not None
        }
        if one.get("speed_factor") is not None or one.get("speed_spread") is not None:
            mean, spread = _usual(name)
            mean = mean if one.get("speed_factor") is None else one["speed_factor"]
            spread = spread if one.get("speed_spread") is None else one["speed_spread"]
            low, high = max(mean - _CUT * spread, 0.1), mean + _CUT * spread
            values["speedFactor"] = f"normc({mean:.3f},{spread:.3f},{low:.3f},{high:.3f})"
        if one.get("acceleration_at_10") is not None:
            most = one.get("acceleration")
            most = float(_parameter(name, "accel", _ACCELERATION)) if most is None else most
            fall = (most - min(one["acceleration_at_10"], most)) / 10.0
            left = [f"{max(most - fall * speed, _LEAST_MS2):.3f}" for speed in _FADES_MS]
            values["speedTable"] = " ".join(f"{speed:g}" for speed in _FADES_MS)
            values["maxAccelProfile"] = " ".join(left)
        if one.get("sideways_acceleration") is not None:
            values[IN_BENDS] = f"{(one['sideways_acceleration'] / SIDEWAYS_MS2) ** 0.5:.3f}"
        found[name] = values
    return found


def _usual(name: str) -> tuple[float, float]:
    """Return mean and standard deviation of the usual desired speed of a class."""
    text = _parameter(name, "speedFactor", "normc(1,0.1,0.2,2)")
    mean, spread = text.removeprefix("normc(").rstrip(")").split(",")[:2]
    return float(mean), float(spread)


def _parameter(name: str, attribute: str, otherwise: str) -> str:
    return ACTOR_KINDS[name].parameters.get(attribute, otherwise)
