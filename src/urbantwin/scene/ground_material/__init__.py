"""Materials of the ground finer than its triangles: road markings and imagery."""

from urbantwin.scene.ground_material.build import (
    GroundMaterials,
    ground_materials,
    paint_layers,
    surface_materials,
)

__all__ = ["GroundMaterials", "ground_materials", "paint_layers", "surface_materials"]
