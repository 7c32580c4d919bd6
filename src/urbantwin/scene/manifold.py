"""Solids that touch themselves, made such that every edge has two faces."""

from __future__ import annotations

from urbantwin.geometry import manifold
from urbantwin.scene.solids import Solid

__all__ = ["with_simple_edges"]


def with_simple_edges(solid: Solid) -> Solid:
    """Return a closed solid in which every edge has exactly two faces."""
    vertices, faces = manifold.with_simple_edges(solid.vertices, solid.faces)
    return Solid(vertices, faces)
