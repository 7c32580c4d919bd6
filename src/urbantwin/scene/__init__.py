"""The static scene as labelled triangles: ground, decks, buildings, poles, trees, barriers."""

from urbantwin.scene.scene import FIRST_OBJECT, Scene, build_scene
from urbantwin.scene.surface import PARTS

__all__ = ["FIRST_OBJECT", "PARTS", "Scene", "build_scene"]
