"""A rig placed in a scene, and the type of the function that places it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from urbantwin.geometry import LabelledMesh
from urbantwin.progress import Progress
from urbantwin.result_warning import ResultWarning
from urbantwin.roads import RoadNetwork
from urbantwin.site import RigSpec, Site

__all__ = ["Stand", "StandingRig"]


@dataclass(frozen=True)
class StandingRig:
    """A rig in a scene.

    Attributes:
        spec: the rig with the positions of all sensors.
        notes: its coverage, for JSON; empty if not computed.
        warnings: warnings about its positions.
    """

    spec: RigSpec
    notes: Mapping[str, Any] = field(default_factory=dict)
    warnings: tuple[ResultWarning, ...] = ()


#: Takes a site, its lanes, the static world, the height of the anchor's ground in the DEM's datum,
#: and a progress callback.
Stand = Callable[[Site, RoadNetwork, LabelledMesh, float | None, Progress], StandingRig]
