"""Bridges of ways that are not in the lane model."""

from urbantwin.scene.bridge.decks import Decks
from urbantwin.scene.bridge.mesh import bridge_mesh
from urbantwin.scene.bridge.profile import bridge_decks

__all__ = ["Decks", "bridge_decks", "bridge_mesh"]
