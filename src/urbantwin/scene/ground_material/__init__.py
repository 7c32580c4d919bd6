"""Materials of the ground finer than its triangles: lane paint, and what imagery shows."""

from urbantwin.scene.ground_material.build import surface_materials
from urbantwin.scene.ground_material.paint import paint_layers

__all__ = ["paint_layers", "surface_materials"]
