"""Colours of a mesh in daylight: by class and material, with slight differences of buildings."""

from __future__ import annotations

from functools import cache

import numpy as np
from matplotlib.colors import to_rgb
from numpy.typing import NDArray

from urbantwin.geometry import LabelledMesh, PartColours
from urbantwin.taxonomy import material_id, materials, semantic_classes, semantic_id

__all__ = ["material_colours", "surface_colours"]

_BY_CLASS = {
    "unlabelled": "#a0a0a0",
    "car": "#3d6fb4",
    "bus": "#d8a21b",
    "on-rails": "#2d7a4f",
    "truck": "#d9dcdf",
    "motorcycle": "#35373b",
    "motorcyclist": "#8c2f3f",
    "bicyclist": "#c2477f",
    "pedestrian": "#d9483b",
    "road": "#5d6166",
    "parking": "#6d7074",
    "sidewalk": "#b9b4aa",
    "other-ground": "#9aa178",
    "building": "#d9cfbf",
    "fence": "#8a8378",
    "other-structure": "#a7a39b",
    "vegetation": "#5e8a3f",
    "trunk": "#6e5238",
    "terrain": "#8aa35f",
    "pole": "#565d64",
    "traffic-sign": "#c8302a",
    "other-object": "#8f8578",
}
#: Colours of class and material, where the material is more specific than the class.
_BY_CLASS_AND_MATERIAL = {
    ("building", "brick"): "#b06a4c",
    ("building", "plaster"): "#e3d8c4",
    ("building", "concrete"): "#c4c1b9",
    ("building", "glass"): "#6f8ea6",
    ("building", "roofing"): "#94614c",
    ("building", "roof-tile"): "#94614c",
    ("building", "roofing-felt"): "#74777a",
    ("building", "slate"): "#5f646a",
    ("building", "stone"): "#b5ad9a",
    ("building", "gravel"): "#a19d93",
    ("building", "grass"): "#7f9f52",
    ("building", "metal-painted"): "#a9b0b6",
    ("building", "wood"): "#a5805a",
    ("other-ground", "asphalt"): "#6a6d71",
    ("other-ground", "concrete"): "#b3afa5",
    ("other-ground", "paving"): "#b3a999",
    ("terrain", "soil"): "#a08a68",
    ("road", "road-paint"): "#f3f1e8",
    ("terrain", "paving"): "#b3a999",
    ("sidewalk", "concrete"): "#c6c2b9",
    ("other-ground", "water"): "#4f7186",
    ("other-ground", "gravel"): "#8f877b",
    ("other-ground", "metal-bare"): "#5b5e62",
    ("other-structure", "glass"): "#8ba3b1",
    ("other-structure", "wood"): "#94714c",
    ("other-object", "wood"): "#94714c",
    ("fence", "wood"): "#94714c",
    ("fence", "brick"): "#a5664a",
    ("fence", "concrete"): "#b0ada6",
    ("fence", "stone"): "#a8a194",
    ("pole", "wood"): "#7d6650",
    ("vegetation", "foliage-needle"): "#436f3c",
}
#: Materials of the ground's triangles, if known from imagery or the lane model.
_ON_THE_GROUND = {
    "road-paint": "#f3f1e8",
    "asphalt": "#5d6166",
    "asphalt-dark": "#45484d",
    "asphalt-light": "#85888a",
    "concrete": "#c6c2b9",
    "paving": "#b3a999",
    "gravel": "#a39b8f",
    "grass": "#7f9f52",
    "soil": "#a08a68",
    "water": "#4f7186",
    "snow": "#f7f9fb",
}
#: Materials with the same colour on every actor.
_ON_ACTORS = {
    "glass": "#27323c",
    "glass-tinted": "#27323c",
    "glass-privacy": "#1c242b",
    "rubber": "#1f2123",
    "metal-dark": "#2e3135",
    "retroreflector": "#f4f1e6",
    "reflex-reflector": "#b3261e",
    "lamp-lens": "#9c2a24",
    "skin": "#d9a583",
    "paint-white": "#e6e7e8",
    "paint-grey": "#8d949b",
    "paint-black": "#25282c",
}
_ACTORS = (
    "car", "bus", "on-rails", "truck", "motorcycle", "motorcyclist", "bicyclist", "pedestrian",
)  # fmt: skip
#: Colours of car paint and of clothes, different from part to part.
_PAINTS = ("#2f6db5", "#b9322c", "#e6e7e8", "#25282c", "#8d949b", "#c9ccd0", "#2c6e5b", "#d6a431")


def surface_colours(
    mesh: LabelledMesh, colours_of: PartColours | None = None
) -> NDArray[np.float64]:
    """Return the colour (F, 3) of every triangle, linear light, 0..1.

    Args:
        mesh: the triangles.
        colours_of: colours of buildings; other buildings differ slightly in shade.
    """
    number = mesh.semantic.astype(np.int64) << 8 | mesh.material
    kinds, kind = _numbered(number)
    colours = np.array([_colour_of(one >> 8, one & 255) for one in kinds.tolist()]).reshape(-1, 3)
    actor = np.isin(kinds >> 8, [semantic_id(name) for name in _ACTORS])
    paint = np.isin(kinds & 255, [material_id("metal-painted"), material_id("cloth")])
    painted = np.flatnonzero((actor & paint)[kind])
    colours = colours.take(kind, axis=0)
    paints = np.array([_linear(paint) for paint in _PAINTS])
    colours[painted] = paints.take(_scattered(mesh.part[painted]) % len(paints), axis=0)

    building = mesh.semantic == semantic_id("building")
    spread = (_scattered(mesh.part[building]) % 1000) / 1000.0 - 0.5
    tint = 1 + spread[:, None] * np.array([0.16, 0.20, 0.26])
    colours[building] = np.clip(colours[building] * tint, 0, 1)
    if colours_of is not None:
        own, known = colours_of.of_faces(mesh, np.flatnonzero(building))
        colours[np.flatnonzero(building)[known]] = (own[known] / 255.0) ** 2.2
    plant = mesh.semantic == semantic_id("vegetation")
    spread = (_scattered(mesh.part[plant]) % 1000) / 1000.0 - 0.5
    colours[plant] *= 1 + spread[:, None] * np.array([0.5, 0.3, 0.3])
    return colours


def _numbered(values: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the unique values, and the index of each value: ``np.unique`` for small integers."""
    there = np.bincount(values, minlength=1) > 0
    return np.flatnonzero(there), (np.cumsum(there) - 1)[values]


def _colour_of(semantic: int, material: int) -> NDArray[np.float64]:
    """Return the colour (3,) of a class and material, linear light, 0..1."""
    name, stuff = _names()[0].get(semantic, ""), _names()[1].get(material, "")
    colour = _BY_CLASS.get(name)
    colour = _BY_CLASS_AND_MATERIAL.get((name, stuff), colour)
    if name in _ACTORS:
        colour = _ON_ACTORS.get(stuff, colour)
    return np.full(3, 0.4) if colour is None else _linear(colour)


@cache
def _names() -> tuple[dict[int, str], dict[int, str]]:
    """Return the names of classes and of materials by number."""
    classes = {one.id: one.name for one in semantic_classes().values()}
    return classes, {one.id: one.name for one in materials().values()}


def material_colours() -> NDArray[np.float64]:
    """Return the colour (M, 3) of materials on the ground by number; grey for all others."""
    return np.array([_linear(_ON_THE_GROUND.get(name, "#9a9a9a")) for name in materials()])


def _linear(colour: str) -> NDArray[np.float64]:
    return np.asarray(to_rgb(colour), np.float64) ** 2.2


def _scattered(parts: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return numbers that differ much between neighbouring parts (Knuth's multiplicative hash)."""
    return ((parts.astype(np.int64) + 1) * 2654435761 % 2**32) >> 8
