"""Sensors: coverage, placement, poses, measured backgrounds, tuning."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.interface.aligned_rig import AlignedRig, align
    from urbantwin.interface.coverage_map import Coverage, coverage
    from urbantwin.interface.discovered_rig import DiscoveredRig, discover
    from urbantwin.interface.measured_background import Background, background
    from urbantwin.interface.placement import Placement, place
    from urbantwin.interface.tuning import Tuning, tune
    from urbantwin.site.rig import RigSpec

__all__ = [
    "AlignedRig",
    "Background",
    "Coverage",
    "DiscoveredRig",
    "Placement",
    "RigSpec",
    "Tuning",
    "align",
    "background",
    "coverage",
    "discover",
    "place",
    "tune",
]

names_on_demand(__name__)
