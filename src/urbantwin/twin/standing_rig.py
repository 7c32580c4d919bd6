"""A rig as it stands on a scene, and what stands it there: packages below know of sensors."""

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
    """A rig on a scene.

    Attributes:
        spec: the rig, every sensor where it stands.
        notes: what it sees, as can stand in JSON; empty where that was not looked at.
        warnings: what is wrong with where it stands.
    """

    spec: RigSpec
    notes: Mapping[str, Any] = field(default_factory=dict)
    warnings: tuple[ResultWarning, ...] = ()


#: Of a site, its lanes, the static world and the height of the anchor's ground in the DEM's datum;
#: the last reports progress.
Stand = Callable[[Site, RoadNetwork, LabelledMesh, float | None, Progress], StandingRig]
