"""Overhead wires: power lines, contact lines of trams and trolleybuses, lamps on span wires."""

from urbantwin.scene.wire.mesh import wire_mesh

__all__ = ["wire_mesh"]
