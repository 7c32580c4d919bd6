"""Trees, rows of trees, woods, orchards, shrubs and hedges."""

from urbantwin.scene.tree.growth import surveyed_tree_mesh
from urbantwin.scene.tree.planting import tree_mesh

__all__ = ["surveyed_tree_mesh", "tree_mesh"]
