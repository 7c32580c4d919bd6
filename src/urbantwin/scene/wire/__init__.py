"""Wires overhead: power lines, contact wires of trams and trolleybuses, lamps hung on wires."""

from urbantwin.scene.wire.mesh import wire_mesh

__all__ = ["wire_mesh"]
