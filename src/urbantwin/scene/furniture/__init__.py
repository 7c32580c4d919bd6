"""Street furniture: benches, shelters, cabinets, advertising, fountains, statues and others."""

from urbantwin.scene.furniture.mesh import furniture_mesh

__all__ = ["furniture_mesh"]
