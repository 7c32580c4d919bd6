"""Meshes told apart: ground, buildings, vegetation, poles and other things, and materials."""

from urbantwin.reconstruct.classify.classify import Classified, classified

__all__ = ["Classified", "classified"]
