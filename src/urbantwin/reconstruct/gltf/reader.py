"""glTF 2.0 files, text and binary, as models.

The reading is our own and not trimesh's: trimesh keeps no feature ids, ignores
``KHR_mesh_quantization``, meshopt and ``CESIUM_RTC``, believes every count that a file claims, and
reports errors by tracebacks. Tests compare ours with it.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable

import numpy as np
from pyproj import CRS

from urbantwin.errors import InputError
from urbantwin.reconstruct.gltf.scene import Scene, read_scene
from urbantwin.reconstruct.gltf.untrusted_values import MalformedError
from urbantwin.reconstruct.model import ImportedModel, PointCloud, TriangleMesh

__all__ = ["Y_UP_TO_Z_UP", "joined_clouds", "read_gltf"]

#: glTF's y axis becomes z, its z axis becomes -y.
Y_UP_TO_Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
#: A point this far from the origin is one of an Earth-centred frame, metres.
EARTH_SIZE = 6.2e6


def read_gltf(data: bytes, resolve: Callable[[str], bytes], *, name: str) -> ImportedModel:
    """Read a ``.gltf`` or ``.glb`` as the file has it.

    Triangles (lists, strips and fans) become the mesh, an object per node, material and feature;
    points become the cloud; lines are left out and counted in ``notes``. Extensions that change
    geometry or colour: ``KHR_draco_mesh_compression``, ``EXT_meshopt_compression``,
    ``KHR_mesh_quantization``, ``EXT_mesh_gpu_instancing``, ``EXT_mesh_features``, ``CESIUM_RTC``,
    ``KHR_texture_transform``, ``EXT_texture_webp``, ``KHR_materials_pbrSpecularGlossiness``.

    Args:
        data: the bytes of the file.
        resolve: gives the bytes of a relative URI of the file; it may raise ``OSError`` or
            ``InputError``.
        name: what the file is called, in errors.

    Returns:
        The model with y up and in metres, as glTF prescribes; with z up where the document gives
        its centre (``CESIUM_RTC``), and in EPSG:4978 where that lies on the Earth's surface.

    Raises:
        InputError: nothing of it can be read.
    """
    files = {name: hashlib.sha256(data).hexdigest()}

    def recorded(uri: str) -> bytes:
        content = resolve(uri)
        files[uri] = hashlib.sha256(content).hexdigest()
        return content

    try:
        scene = read_scene(data, recorded)
    except MalformedError as error:
        raise InputError(str(error), file=name, expected="glTF 2.0") from None
    mesh = TriangleMesh.concatenate(scene.meshes) if scene.meshes else None
    cloud = joined_clouds(scene.clouds)
    if (mesh is None or not len(mesh.faces)) and cloud is None:
        why = scene.problems[0] if scene.problems else "holds no triangles and no points"
        raise InputError(why, file=name, expected="glTF 2.0 with a surface")
    return _placed(scene, mesh, cloud, files)


def joined_clouds(clouds: tuple[PointCloud, ...]) -> PointCloud | None:
    """Return clouds as one; mid-grey where only some have colour."""
    clouds = tuple(cloud for cloud in clouds if len(cloud.points))
    if not clouds:
        return None
    colour = None
    if any(cloud.colour is not None for cloud in clouds):
        colour = np.concatenate(
            [
                np.full((len(c.points), 3), 128, np.uint8) if c.colour is None else c.colour
                for c in clouds
            ]
        )
    return PointCloud(np.concatenate([cloud.points for cloud in clouds]), colour)


def _placed(
    scene: Scene, mesh: TriangleMesh | None, cloud: PointCloud | None, files: dict[str, str]
) -> ImportedModel:
    notes: dict[str, object] = {f"{key} left out": n for key, n in scene.skipped.items()}
    if scene.copyright:
        notes["copyright"] = scene.copyright
    up, crs = "y", None
    if scene.centre is not None:
        up = "z"
        if np.linalg.norm(scene.centre) > EARTH_SIZE:
            crs = CRS.from_epsg(4978)
        if mesh is not None:
            mesh = TriangleMesh(
                mesh.vertices @ Y_UP_TO_Z_UP.T + scene.centre,
                mesh.faces,
                mesh.colour,
                mesh.object,
                mesh.names,
            )
        if cloud is not None:
            cloud = PointCloud(cloud.points @ Y_UP_TO_Z_UP.T + scene.centre, cloud.colour)
    return ImportedModel(
        mesh=mesh,
        cloud=cloud,
        crs=crs,
        up=up,
        unit_m=1.0,
        problems=scene.problems,
        notes=notes,
        files=files,
    )
