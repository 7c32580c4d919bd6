"""What moves and what waits in frames of sensors that stand still: objects, and their tracks."""

from urbantwin.traffic.observed.observe import Observation, observe
from urbantwin.traffic.observed.observed_tracks import (
    ObservedTracks,
    is_observation,
    read_observation,
)
from urbantwin.traffic.observed.written import write_observation

__all__ = [
    "Observation",
    "ObservedTracks",
    "is_observation",
    "observe",
    "read_observation",
    "write_observation",
]
