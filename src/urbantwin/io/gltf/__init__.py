"""glTF 2.0: scenes of triangles and points, alone or inside tiles."""

from urbantwin.io.gltf.scene import read_gltf

__all__ = ["read_gltf"]
