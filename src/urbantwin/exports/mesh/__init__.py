"""Named mesh objects in the formats of other programs."""

from urbantwin.exports.mesh.fbx import check_fbx, write_fbx
from urbantwin.exports.mesh.gltf import write_glb
from urbantwin.exports.mesh.mesh_object import Look, MeshObject
from urbantwin.exports.mesh.wavefront import write_obj

__all__ = [
    "Look",
    "MeshObject",
    "check_fbx",
    "write_fbx",
    "write_glb",
    "write_obj",
]
