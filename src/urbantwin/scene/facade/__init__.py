"""Facades: walls visible from the road, with recessed windows and doors."""

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
