"""Recorded tracks of sensors, annotators or programs, read into the site frame."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.traffic.recorded.description import TracksSpec
    from urbantwin.traffic.recorded.read import read_recording
    from urbantwin.traffic.recorded.track import RecordedTrack, Recording

__all__ = ["RecordedTrack", "Recording", "TracksSpec", "read_recording"]

names_on_demand(__name__)
