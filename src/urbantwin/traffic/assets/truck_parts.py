"""Trucks by the annotation rules of TUMTraf: the cab is a truck, its load a trailer.

This follows their labelling instructions (``labeling_instructions.md`` of the tool proAnno), for a
box, a tipper or a mixer. A tractor ends where its trailer begins.
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

#: Overhang beyond the end of a cab that still belongs to the cab, metres.
_CAB_OVERHANG_M = 0.02
#: Separator between the name of a truck and that of its part.
_PART_SEPARATOR = "|"


class TruckPart(NamedTuple):
    """A part of a truck.

    Attributes:
        actor_class: ``truck`` or ``trailer``.
        name: name of its mesh (`mesh_of_part`), in the truck's own frame.
        size: length, width and height, metres.
        ahead_m: distance of its centre ahead of the truck's, metres.
    """

    actor_class: str
    name: str
    size: Size
    ahead_m: float


@lru_cache(maxsize=512)
def truck_parts(name: str) -> tuple[TruckPart, ...]:
    """Return cab and load of a truck, of a tractor its cab alone; empty for assets without a cab.

    Args:
        name: name of an asset.
    """
    try:
        cab_m, length = asset(name).cab_m, asset(name).length
    except InputError:  # an asset that a site defines
        return ()
    if cab_m is None:
        return ()
    corners = asset_mesh(name).vertices.astype(np.float64)
    from_nose = corners[:, 0].max() - corners[:, 0]
    truck = []
    for kind, in_part, from_m, to_m in (
        ("truck", from_nose <= cab_m + _CAB_OVERHANG_M, 0.0, cab_m),
        ("trailer", from_nose > cab_m, cab_m, length),
    ):
        width, height = float(np.ptp(corners[in_part, 1])), float(corners[in_part, 2].max())
        size = (to_m - from_m, width, height)
        truck.append(
            TruckPart(kind, f"{name}{_PART_SEPARATOR}{kind}", size, (length - from_m - to_m) / 2)
        )
    if not asset(name).loaded:
        return (truck[0]._replace(name=name),)
    return tuple(truck)


def mesh_of_part(meshes: Callable[[str, int], LabelledMesh], name: str, phase: int) -> LabelledMesh:
    """Return the mesh of an asset, or of a truck's part: the solids of its cab or of its load.

    Args:
        meshes: returns the mesh of an asset in a phase.
        name: name of an asset, or of a `TruckPart`.
        phase: phase of its movement.
    """
    whole, _, kind = name.partition(_PART_SEPARATOR)
    mesh, cab_m = meshes(whole, phase), asset(whole).cab_m if kind else None
    if cab_m is None:
        return mesh
    middles = mesh.triangles()[..., 0].mean(axis=1)
    count = np.maximum(np.bincount(mesh.part), 1)
    from_nose = mesh.vertices[:, 0].max() - np.bincount(mesh.part, middles) / count
    cab = from_nose[mesh.part] <= cab_m
    return mesh.select(cab if kind == "truck" else ~cab)
