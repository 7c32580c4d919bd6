"""Files that people have: meshes, city models and point clouds, read as they are."""

from urbantwin.reconstruct.formats.read import read_model

__all__ = ["read_model"]
