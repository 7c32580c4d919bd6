"""Objects and tracks from frames of stationary sensors."""

from urbantwin.traffic.observed.frame_times import FrameTimes, read_frame_times
from urbantwin.traffic.observed.observe import Observation, observe
from urbantwin.traffic.observed.observed_tracks import (
    ObservedTracks,
    is_observation,
    read_observation,
)
from urbantwin.traffic.observed.written import (
    spacing_summary,
    spacing_warnings,
    write_observation,
)

__all__ = [
    "FrameTimes",
    "Observation",
    "ObservedTracks",
    "is_observation",
    "observe",
    "read_frame_times",
    "read_observation",
    "spacing_summary",
    "spacing_warnings",
    "write_observation",
]
