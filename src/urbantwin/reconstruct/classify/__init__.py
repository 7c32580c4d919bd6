"""Classification of meshes: ground, buildings, vegetation, poles, other; and materials."""

from urbantwin.reconstruct.classify.classify import Classified, classified

__all__ = ["Classified", "classified"]
