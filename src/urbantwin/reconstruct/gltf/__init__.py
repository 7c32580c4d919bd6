"""glTF: scenes of triangles and points, alone or inside tiles."""

from urbantwin.reconstruct.gltf.reader import read_gltf

__all__ = ["read_gltf"]
