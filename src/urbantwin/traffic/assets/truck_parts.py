"""Trucks as the annotators of TUMTraf have them: a cab is a truck, what it carries a trailer.

So their instructions say (``labeling_instructions.md`` of proAnno, the tool): be the load a box, a
tipper or a mixer. A tractor ends where its trailer begins.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from urbantwin.errors import InputError
from urbantwin.geometry import LabelledMesh
from urbantwin.traffic.assets.asset_name import Size
from urbantwin.traffic.assets.catalogue import asset, asset_mesh

__all__ = ["TruckPart", "mesh_of_part", "truck_parts"]

#: What hangs over the end of a cab by less than this is of the cab, metres.
_OVER_M = 0.02
#: Between the name of a truck and which of its parts is meant.
_MARK = "|"


class TruckPart(NamedTuple):
    """A part of a truck.

    Attributes:
        actor_class: ``truck`` or ``trailer``.
        name: of its mesh (`mesh_of_part`), in the truck's own frame.
        size: length, width and height, metres.
        ahead_m: how far its middle is ahead of the truck's.
    """

    actor_class: str
    name: str
    size: Size
    ahead_m: float


@lru_cache(maxsize=512)
def truck_parts(name: str) -> tuple[TruckPart, ...]:
    """Return cab and load of a truck, of a tractor its cab alone; none of what has no cab.

    Args:
        name: of an asset.
    """
    try:
        cab_m, length = asset(name).cab_m, asset(name).length
    except InputError:  # a body that a site brings along
        return ()
    if cab_m is None:
        return ()
    corners = asset_mesh(name).vertices.astype(np.float64)
    behind = corners[:, 0].max() - corners[:, 0]
    found = []
    for kind, mine, from_m, to_m in (
        ("truck", behind <= cab_m + _OVER_M, 0.0, cab_m),
        ("trailer", behind > cab_m, cab_m, length),
    ):
        width, height = float(np.ptp(corners[mine, 1])), float(corners[mine, 2].max())
        size = (to_m - from_m, width, height)
        found.append(TruckPart(kind, f"{name}{_MARK}{kind}", size, (length - from_m - to_m) / 2))
    if not asset(name).loaded:
        return (found[0]._replace(name=name),)
    return tuple(found)


def mesh_of_part(meshes: Callable[[str, int], LabelledMesh], name: str, phase: int) -> LabelledMesh:
    """Return the mesh of an asset, or of a part of a truck: its solids that are cab, or load.

    Args:
        meshes: gives the mesh of an asset in a phase.
        name: of an asset, or of a `TruckPart`.
        phase: of its movement.
    """
    whole, _, kind = name.partition(_MARK)
    mesh, cab_m = meshes(whole, phase), asset(whole).cab_m if kind else None
    if cab_m is None:
        return mesh
    middles = mesh.triangles()[..., 0].mean(axis=1)
    count = np.maximum(np.bincount(mesh.part), 1)
    behind = mesh.vertices[:, 0].max() - np.bincount(mesh.part, middles) / count
    cab = behind[mesh.part] <= cab_m
    return mesh.select(cab if kind == "truck" else ~cab)
