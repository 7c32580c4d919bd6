"""Materials of exported scenes: colour and properties by class and material."""

from __future__ import annotations

from urbantwin.exports.mesh import Look
from urbantwin.taxonomy import Material, SemanticClass, materials, semantic_classes

__all__ = ["look_of", "material_label"]

#: Colours of materials in daylight, linear RGB.
_COLOURS = {
    "asphalt": (0.10, 0.10, 0.11),
    "asphalt-dark": (0.05, 0.05, 0.055),
    "asphalt-light": (0.20, 0.20, 0.20),
    "road-paint": (0.80, 0.80, 0.78),
    "concrete": (0.45, 0.45, 0.43),
    "paving": (0.42, 0.40, 0.37),
    "stone": (0.38, 0.36, 0.33),
    "gravel": (0.33, 0.30, 0.26),
    "grass": (0.14, 0.28, 0.09),
    "soil": (0.25, 0.18, 0.12),
    "snow": (0.90, 0.91, 0.93),
    "water": (0.06, 0.14, 0.20),
    "brick": (0.38, 0.15, 0.10),
    "plaster": (0.62, 0.58, 0.50),
    "roofing": (0.22, 0.12, 0.10),
    "roof-tile": (0.36, 0.13, 0.08),
    "roofing-felt": (0.10, 0.10, 0.10),
    "slate": (0.13, 0.14, 0.16),
    "glass": (0.15, 0.20, 0.24),
    "glass-tinted": (0.10, 0.15, 0.16),
    "glass-privacy": (0.05, 0.06, 0.07),
    "foliage": (0.07, 0.22, 0.05),
    "foliage-needle": (0.04, 0.15, 0.06),
    "bark": (0.16, 0.11, 0.07),
    "wood": (0.30, 0.20, 0.11),
    "metal-painted": (0.28, 0.29, 0.31),
    "paint-white": (0.79, 0.80, 0.81),
    "paint-grey": (0.27, 0.30, 0.33),
    "paint-black": (0.02, 0.02, 0.025),
    "metal-dark": (0.06, 0.06, 0.065),
    "metal-bare": (0.50, 0.51, 0.52),
    "rubber": (0.02, 0.02, 0.02),
    "plastic": (0.45, 0.45, 0.45),
    "retroreflector": (0.85, 0.80, 0.20),
    "reflex-reflector": (0.60, 0.05, 0.04),
    "lamp-lens": (0.50, 0.05, 0.04),
    "cloth": (0.20, 0.22, 0.35),
    "skin": (0.55, 0.35, 0.26),
}
_GREY = (0.5, 0.5, 0.5)
#: Opacity of glass.
_GLASS_ALPHA = 0.5


def material_label(semantic: SemanticClass, material: Material) -> str:
    """Return ``building/brick``: a material name that includes the semantic class."""
    return f"{semantic.name}/{material.name}"


def look_of(semantic: int, material: int) -> tuple[str, Look]:
    """Return name and appearance for triangles of a class and a material.

    The extras are the class, its number, the material and its reflectivities.

    Args:
        semantic: number of the class.
        material: number of the material.
    """
    kind = {one.id: one for one in semantic_classes().values()}[semantic]
    stuff = {one.id: one for one in materials().values()}[material]
    extras: dict[str, object] = {
        "semantic": kind.name,
        "semantic_id": kind.id,
        "material": stuff.name,
        "reflectivity_905nm": stuff.reflectivity,
        "transmission": stuff.transmission,
    }
    clear = _GLASS_ALPHA if stuff.transmission > 0.5 else 1.0
    look = Look(_COLOURS.get(stuff.name, _GREY), clear, extras)
    return material_label(kind, stuff), look
