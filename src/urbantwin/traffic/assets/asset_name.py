"""Names of assets: body, colour and individual size, as in ``car-sedan_black@4.70x1.85x1.45``.

The size is length, width and height in metres, rounded to centimetres, so that actors of the same
size share a mesh.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from urbantwin.geometry import LabelledMesh
from urbantwin.taxonomy import material_id

__all__ = [
    "COATED_CLASSES",
    "COATS",
    "AssetName",
    "Size",
    "coat_at",
    "coated_mesh",
    "coated_name",
    "mesh_among",
    "scaled_mesh",
    "sized_name",
]

#: Length, width and height, metres.
Size = tuple[float, float, float]

_SIZED_NAME = re.compile(r"(.+)@(\d+\.\d\d)x(\d+\.\d\d)x(\d+\.\d\d)")
#: Least size, metres.
_MIN_SIZE_M = 0.01


class AssetName(NamedTuple):
    """The parts of an asset's name.

    Attributes:
        body: name in the catalogue.
        coat: paint of a vehicle; empty for none.
        size: size of the actor; ``None``: that of the body.
    """

    body: str
    coat: str = ""
    size: Size | None = None

    @classmethod
    def of(cls, text: str) -> AssetName:
        """Parse a name."""
        match = _SIZED_NAME.fullmatch(text)
        size = None if match is None else (float(match[2]), float(match[3]), float(match[4]))
        bare = text if match is None else match[1]
        body, between, coat = bare.rpartition("_")
        return cls(body, coat, size) if between and coat in COATS else cls(bare, "", size)

    def __str__(self) -> str:
        """Write the name."""
        name = f"{self.body}_{self.coat}" if self.coat else self.body
        return name if self.size is None else sized_name(name, *self.size)

    @property
    def unsized(self) -> str:
        """The name without a size."""
        return str(self._replace(size=None))


def sized_name(name: str, length: float, width: float, height: float) -> str:
    """Return the name of an asset with another size, metres, of at least a centimetre."""
    sides = (max(side, _MIN_SIZE_M) for side in (length, width, height))
    return f"{name}@{'x'.join(f'{side:.2f}' for side in sides)}"


#: Height below which a solid counts as standing on the ground, metres.
_ON_GROUND_M = 1e-3


def scaled_mesh(mesh: LabelledMesh, factors: tuple[float, float, float]) -> LabelledMesh:
    """Return a mesh scaled along x, y and z.

    Solids on the ground are wheels and shoes: along x they are scaled by the factor of z, about
    their middle.
    """
    if factors == (1.0, 1.0, 1.0):
        return mesh
    vertices = mesh.vertices * np.asarray(factors, mesh.vertices.dtype)
    part = np.zeros(len(vertices), np.int64)
    part[mesh.faces.reshape(-1)] = np.repeat(mesh.part, 3)
    for number in np.unique(part[mesh.vertices[:, 2] < _ON_GROUND_M]):
        of_part = part == number
        x = mesh.vertices[of_part, 0].astype(np.float64)
        middle = (x.min() + x.max()) / 2
        vertices[of_part, 0] = middle * factors[0] + (x - middle) * factors[2]
    return replace(mesh, vertices=vertices)


def mesh_among(
    meshes: Mapping[tuple[str, int], LabelledMesh],
    name: str,
    phase: int,
    otherwise: Callable[[str, int], LabelledMesh],
) -> LabelledMesh:
    """Return the mesh of an asset and phase: the asset's own, or that of its body, scaled.

    Args:
        meshes: meshes by name and phase.
        name: name of the asset.
        phase: phase of its movement.
        otherwise: returns the mesh if neither is available.
    """
    own = meshes.get((name, phase))
    if own is not None:
        return own
    unsized = AssetName.of(name).unsized
    body, first = meshes.get((unsized, phase)), meshes.get((unsized, 0))
    size = AssetName.of(name).size
    if body is None or first is None or size is None:
        return otherwise(name, phase)
    x, y, z = np.asarray(size) / np.ptp(first.vertices, axis=0)
    return scaled_mesh(body, (float(x), float(y), float(z)))


#: Colour -> share of vehicles, except vans.
COATS: dict[str, float] = {"white": 4 / 19, "grey": 6 / 19, "black": 9 / 19}
_VAN_COLOURS = {"white": 0.57, "grey": 0.10, "black": 0.33}
#: Classes of actors with colours.
COATED_CLASSES = ("car", "truck", "bus", "van")
#: Glass above this share of a car's height is a window, below a lamp; share for long vehicles, and
#: their least length, metres.
_PANE_SHARE, _LONG_PANE_SHARE, _LONG_VEHICLE_M = 0.58, 0.25, 6.5
#: Windows of a long vehicle beyond this share of its half length are its windscreen.
_WINDSCREEN = 0.85
_GOLDEN_RATIO = (5**0.5 - 1) / 2  # spreads the colours evenly over few vehicles, too


def coated_name(name: str, number: int, actor_class: str) -> str:
    """Return the name of an asset in the colour of the n-th vehicle of a class."""
    return f"{name}_{coat_at((number + 0.5) * _GOLDEN_RATIO % 1.0, actor_class)}"


def coat_at(place: float, actor_class: str) -> str:
    """Return the colour at a quantile, 0..1, of the vehicles of a class."""
    shares = _VAN_COLOURS if actor_class == "van" else COATS
    ends = np.cumsum(list(shares.values()))
    return list(COATS)[min(int(np.searchsorted(ends, place, side="right")), len(COATS) - 1)]


def coated_mesh(mesh: LabelledMesh, coat: str) -> LabelledMesh:
    """Return a vehicle's mesh with coloured paint and tinted windows."""
    material = mesh.material.copy()
    material[material == material_id("metal-painted")] = material_id(f"paint-{coat}")
    middle = mesh.triangles().mean(axis=1)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    is_long = high[0] - low[0] > _LONG_VEHICLE_M
    share = _LONG_PANE_SHARE if is_long else _PANE_SHARE
    panes = (mesh.material == material_id("glass")) & (middle[:, 2] > share * high[2])
    material[panes] = material_id("glass-tinted")
    ahead = (low[0] + high[0]) / 2 + (_WINDSCREEN * (high[0] - low[0]) / 2 if is_long else 0.0)
    if is_long or coat != "white":
        material[panes & (middle[:, 0] < ahead)] = material_id("glass-privacy")
    return replace(mesh, material=material)
