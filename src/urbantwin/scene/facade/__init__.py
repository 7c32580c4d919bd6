"""Facades: which walls are seen, and the windows and doors that are set back in them."""

from urbantwin.scene.facade.front import Front
from urbantwin.scene.facade.layout import facade_openings, mapped_doors
from urbantwin.scene.facade.wall import Opening, Wall, WallMesh, wall_mesh

__all__ = [
    "Front",
    "Opening",
    "Wall",
    "WallMesh",
    "facade_openings",
    "mapped_doors",
    "wall_mesh",
]
