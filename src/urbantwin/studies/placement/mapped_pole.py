"""The mapped poles, lamps, masts and signals of a twin, as its scene has them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import LabelledMesh
from urbantwin.taxonomy import semantic_id

__all__ = ["MappedPole", "mapped_poles"]

#: The foot of a pole is the middle of what is so near to its lowest point, metres.
_FOOT_M = 0.3
#: Poles nearer to each other than this are one place, metres.
_SAME_M = 1.0
#: What a signal shows its lights with.
_LIGHTS = "other-object"


@dataclass(frozen=True, eq=False)
class MappedPole:
    """A pole.

    Attributes:
        foot: (2,) site frame, metres.
        top_m: z of its top, site frame.
        signal: whether it carries lights of signals.
    """

    foot: NDArray[np.float64]
    top_m: float
    signal: bool


def mapped_poles(
    mesh: LabelledMesh, middle: NDArray[np.float64], within_m: float, *, signals: bool
) -> list[MappedPole]:
    """Return the poles around a point, of which the scene makes a part each.

    Args:
        mesh: the static world, site frame.
        middle: (2,) of the junction.
        within_m: of it.
        signals: those that carry signals, or all others.
    """
    steel = np.flatnonzero(mesh.semantic == semantic_id("pole"))
    with_lights = set(mesh.part[mesh.semantic == semantic_id(_LIGHTS)].tolist())
    found: list[MappedPole] = []
    for part in np.unique(mesh.part[steel]).tolist():
        corners = mesh.vertices[np.unique(mesh.faces[steel[mesh.part[steel] == part]])]
        low = corners[corners[:, 2] <= corners[:, 2].min() + _FOOT_M]
        foot = (low[:, :2].min(axis=0) + low[:, :2].max(axis=0)) / 2
        signal = part in with_lights
        if signal != signals or np.linalg.norm(foot - middle) > within_m:
            continue
        if any(np.linalg.norm(foot - one.foot) < _SAME_M for one in found):
            continue
        found.append(MappedPole(foot, float(corners[:, 2].max()), signal))
    return found
