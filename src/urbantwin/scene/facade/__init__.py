"""Facades: walls visible from the road, with windows and doors set back in them."""

from urbantwin.scene.facade.layout import facade_openings
from urbantwin.scene.facade.style import Door, mapped_doors, mapped_shops
from urbantwin.scene.facade.wall import Front, Opening, Wall, WallMesh, wall_mesh

__all__ = [
    "Door",
    "Front",
    "Opening",
    "Wall",
    "WallMesh",
    "facade_openings",
    "mapped_doors",
    "mapped_shops",
    "wall_mesh",
]
