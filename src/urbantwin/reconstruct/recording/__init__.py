"""Recordings of fixed sensors: the static world, and moving points."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.reconstruct.recording.looks import LEAST_FRAMES, Looks, moving_points
    from urbantwin.reconstruct.recording.recorded_frames import RecordedFrame, RecordedFrames

__all__ = ["LEAST_FRAMES", "Looks", "RecordedFrame", "RecordedFrames", "moving_points"]

names_on_demand(__name__)
