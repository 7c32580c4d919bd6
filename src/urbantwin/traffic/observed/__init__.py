"""What moves and what waits in frames of sensors that stand still: objects, and their tracks."""

from urbantwin.traffic.observed.observe import Observation, observe
from urbantwin.traffic.observed.written import write_observation

__all__ = ["Observation", "observe", "write_observation"]
