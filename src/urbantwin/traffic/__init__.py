"""Traffic: demand, SUMO in a process of its own, actors that stand on the ground, the motion."""

from urbantwin.traffic.motion import Motion, describe
from urbantwin.traffic.run import run_traffic

__all__ = ["Motion", "describe", "run_traffic"]
