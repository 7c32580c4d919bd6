"""Recordings of sensors that stand still: what always stands there, and what moves."""

from urbantwin.reconstruct.recording.looks import LEAST_FRAMES, Looks, moving_points
from urbantwin.reconstruct.recording.recorded_frames import RecordedFrame, RecordedFrames

__all__ = ["LEAST_FRAMES", "Looks", "RecordedFrame", "RecordedFrames", "moving_points"]
