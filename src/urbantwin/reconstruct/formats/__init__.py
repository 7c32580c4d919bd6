"""Files that people have: meshes, city models and point clouds, read as they are."""

from urbantwin.reconstruct.formats.photogrammetry import holds_model
from urbantwin.reconstruct.formats.read import read_model

__all__ = ["holds_model", "read_model"]
