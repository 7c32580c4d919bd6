"""Traffic: demand, simulation in SUMO, actors on the ground, and the resulting motion."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.interface.film import Film, film
    from urbantwin.interface.observed_traffic import ObservedTraffic, observe
    from urbantwin.interface.recorded_traffic import Calibration, calibrate, replay
    from urbantwin.traffic.motion import Motion, describe
    from urbantwin.traffic.run import run_traffic

__all__ = [
    "Calibration",
    "Film",
    "Motion",
    "ObservedTraffic",
    "calibrate",
    "describe",
    "film",
    "observe",
    "replay",
    "run_traffic",
]

names_on_demand(__name__)
