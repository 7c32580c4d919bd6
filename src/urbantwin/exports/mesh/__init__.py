"""Named objects of triangles, written as other programs read them."""

from urbantwin.exports.mesh.fbx import HOW_TO_GET_FBX, blender_python, write_fbx
from urbantwin.exports.mesh.gltf import write_glb
from urbantwin.exports.mesh.mesh_object import Look, MeshObject
from urbantwin.exports.mesh.wavefront import write_obj

__all__ = [
    "HOW_TO_GET_FBX",
    "Look",
    "MeshObject",
    "blender_python",
    "write_fbx",
    "write_glb",
    "write_obj",
]
