"""Discovery of the sensors that recorded unlabelled frames, from their points."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.fidelity.discovery.discover import discover
    from urbantwin.fidelity.discovery.recording import (
        discover_recording,
        draw_discovery,
        write_frames,
        write_rig,
    )
    from urbantwin.fidelity.discovery.result import Discovery, FoundSensor

__all__ = [
    "Discovery",
    "FoundSensor",
    "discover",
    "discover_recording",
    "draw_discovery",
    "write_frames",
    "write_rig",
]

names_on_demand(__name__)
