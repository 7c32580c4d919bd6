"""Readers of meshes, city models and point clouds, which give what the files hold."""

from urbantwin.reconstruct.formats.photogrammetry import holds_model
from urbantwin.reconstruct.formats.read import read_model

__all__ = ["holds_model", "read_model"]
