"""A glTF document as meshes and points: nodes, placed meshes, and whole files.

The reader is our own because trimesh keeps no feature ids, ignores ``KHR_mesh_quantization``,
meshopt and ``CESIUM_RTC``, trusts every count of a file, and reports errors by tracebacks. Tests
compare both.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS
from scipy.spatial.transform import Rotation

from urbantwin.errors import InputError
from urbantwin.io.gltf.data import Accessors, Buffers, open_container
from urbantwin.io.gltf.primitive import FARTHEST, Primitive, PrimitiveReader
from urbantwin.io.model import ImportedModel, PointCloud, TriangleMesh
from urbantwin.io.values import (
    MalformedError,
    items,
    matrix,
    numbers,
    table,
    text,
    whole,
)

__all__ = ["MOST_TRIANGLES", "Y_UP_TO_Z_UP", "joined_clouds", "read_gltf", "read_scene", "shown"]

_MOST_NODES = 1_000_000
_DEEPEST = 256


@dataclass(frozen=True)
class PlacedMesh:
    """A mesh with its transforms.

    Attributes:
        mesh: index of the mesh in the document.
        name: name of its node.
        transforms: (I, 4, 4) float64, from the mesh to the scene.
        node: index of its node.
    """

    mesh: int
    name: str
    transforms: NDArray[np.float64]
    node: int


def placed_meshes(
    document: dict[str, Any], accessors: Accessors, problems: list[str]
) -> Iterator[PlacedMesh]:
    """Yield the meshes of the scene, node by node, parents before their children.

    A node that does not exist, that is reached twice (a cycle, two parents) or that is invalid is
    left out with its descendants, and adds a line to ``problems``.

    Source: glTF 2.0, section 3.5 "Scenes" (nodes are strict trees); ``EXT_mesh_gpu_instancing``.

    Raises:
        MalformedError: there is no scene, or its nodes exceed the limits.
    """
    nodes = items(document, "nodes")
    pending = [(number, np.eye(4), 0) for number in reversed(_roots(document, nodes))]
    seen: set[int] = set()
    while pending:
        number, above, depth = pending.pop()
        if depth > _DEEPEST or len(seen) > _MOST_NODES:
            raise MalformedError("has nodes nested or numbered beyond reason")
        try:
            if number >= len(nodes) or not isinstance(nodes[number], dict):
                raise MalformedError("does not exist")
            if number in seen:
                raise MalformedError("is reached twice: nodes are not a tree")
            seen.add(number)
            node: dict[str, Any] = nodes[number]
            here = above @ _local(node)
            below = [
                whole({"child": child}, "child") for child in reversed(items(node, "children"))
            ]
            placed = _placed(node, number, here, accessors)
        except MalformedError as error:
            problems.append(f"node {number} {error}")
            continue
        if placed is not None:
            yield placed
        pending.extend((child, here, depth + 1) for child in below)


def _placed(
    node: dict[str, Any], number: int, here: NDArray[np.float64], accessors: Accessors
) -> PlacedMesh | None:
    """Return the mesh of a node, if it has one, with all its transforms."""
    if node.get("mesh") is None:
        return None
    instances = table(table(node, "extensions"), "EXT_mesh_gpu_instancing")
    transforms = here @ _instances(instances, accessors) if instances else here[None]
    return PlacedMesh(whole(node, "mesh"), text(node, "name"), transforms, number)


def _roots(document: dict[str, Any], nodes: list[Any]) -> list[int]:
    """Return the root nodes of the displayed scene; of all nodes if there is no scene."""
    scenes = items(document, "scenes")
    if scenes:
        number = whole(document, "scene", 0)
        if number >= len(scenes) or not isinstance(scenes[number], dict):
            raise MalformedError(f"refers to scene {number}, which it does not have")
        return [whole({"node": node}, "node") for node in items(scenes[number], "nodes")]
    below = {
        child
        for node in nodes
        if isinstance(node, dict)
        for child in items(node, "children")
        if isinstance(child, int)
    }
    return [number for number in range(len(nodes)) if number not in below]


def _local(node: dict[str, Any]) -> NDArray[np.float64]:
    """Return a node's own transform: its matrix, or translation x rotation x scale."""
    if node.get("matrix") is not None:
        return matrix(node, "matrix")
    result = np.eye(4)
    rotation = numbers(node, "rotation", 4, [0.0, 0.0, 0.0, 1.0])
    if not np.linalg.norm(rotation) > 1e-9:
        raise MalformedError("has a rotation that is zero")
    result[:3, :3] = Rotation.from_quat(rotation).as_matrix()
    result[:3, :3] *= numbers(node, "scale", 3, [1.0, 1.0, 1.0])
    result[:3, 3] = numbers(node, "translation", 3, [0.0, 0.0, 0.0])
    return result


def _instances(extension: dict[str, Any], accessors: Accessors) -> NDArray[np.float64]:
    """Return (I, 4, 4) transforms of instances within their node."""
    attributes = table(extension, "attributes")
    columns = {"TRANSLATION": 3, "ROTATION": 4, "SCALE": 3}
    read = {}
    for key, width in columns.items():
        if attributes.get(key) is not None:
            read[key] = accessors.values(whole(attributes, key))
            if read[key].shape[1] != width:
                raise MalformedError(f"has instances with a {key} of {read[key].shape[1]} numbers")
    counts = {len(rows) for rows in read.values()}
    if len(counts) != 1:
        raise MalformedError("has instances with attributes of different lengths")
    count = counts.pop()
    if not all(np.isfinite(rows).all() for rows in read.values()):
        raise MalformedError("has instances whose places are not finite")
    result = np.broadcast_to(np.eye(4), (count, 4, 4)).copy()
    if "ROTATION" in read and count:
        if not (np.linalg.norm(read["ROTATION"], axis=1) > 1e-9).all():
            raise MalformedError("has an instance whose rotation is zero")
        result[:, :3, :3] = Rotation.from_quat(read["ROTATION"]).as_matrix()
    if "SCALE" in read:
        result[:, :3, :3] *= read["SCALE"][:, None, :]
    if "TRANSLATION" in read:
        result[:, :3, 3] = read["TRANSLATION"]
    return result


#: Maximum number of triangles (and points) of a document, including instances.
MOST_TRIANGLES = 20_000_000


@dataclass(frozen=True, eq=False)
class Scene:
    """The content of a document.

    Attributes:
        meshes: one per primitive and instance; y up.
        clouds: primitives of points; y up.
        centre: (3,) added after the conversion to z up (``CESIUM_RTC``), or ``None``.
        problems: omissions, a line each.
        copyright: copyright statement of the document.
        skipped: counts of elements without a surface, by name.
    """

    meshes: tuple[TriangleMesh, ...]
    clouds: tuple[PointCloud, ...]
    centre: NDArray[np.float64] | None
    problems: tuple[str, ...]
    copyright: str
    skipped: dict[str, int]


@np.errstate(all="ignore")  # values that are not finite are found and reported
def read_scene(
    data: bytes, resolve: Callable[[str], bytes], *, feature_names: Sequence[str] = ()
) -> Scene:
    """Read a glTF document.

    Args:
        data: the bytes of a ``.gltf`` or ``.glb``.
        resolve: returns the bytes of a relative URI; it may raise ``OSError`` or ``InputError``.
        feature_names: names of features by index, if given outside of the document (in a batch
            table).

    Raises:
        MalformedError: nothing can be read.
    """

    def fetch(uri: str) -> bytes:
        try:
            return resolve(uri)
        except (OSError, InputError, KeyError) as error:
            why = error.problem if isinstance(error, InputError) else "cannot be read"
            raise MalformedError(f"{shown(uri)} {why}") from None

    document, binary = open_container(data)
    buffers = Buffers(document, binary, fetch)
    reader = PrimitiveReader(document, buffers)
    extensions = table(document, "extensions")
    centre = None
    if table(extensions, "CESIUM_RTC"):
        centre = numbers(table(extensions, "CESIUM_RTC"), "center", 3)
    gathered = _Gathered(reader, items(document, "meshes"), feature_names)
    for placed in placed_meshes(document, reader.accessors, gathered.problems):
        gathered.add(placed)
    skipped = {"primitives of lines": gathered.lines} if gathered.lines else {}
    if document.get("skins"):
        skipped["skins"] = len(items(document, "skins"))
    return Scene(
        tuple(gathered.meshes),
        tuple(gathered.clouds),
        centre,
        (*dict.fromkeys(gathered.problems), *reader.materials.problems),
        text(table(document, "asset"), "copyright"),
        skipped,
    )


class _Gathered:
    """Meshes and clouds of a scene, as nodes are visited."""

    def __init__(
        self, reader: PrimitiveReader, meshes: list[Any], feature_names: Sequence[str]
    ) -> None:
        self._reader = reader
        self._specs = meshes
        self._feature_names = feature_names
        self._read: dict[int, list[Primitive]] = {}
        self._left = MOST_TRIANGLES
        self.meshes: list[TriangleMesh] = []
        self.clouds: list[PointCloud] = []
        self.problems: list[str] = []
        self.lines = 0

    def add(self, placed: PlacedMesh) -> None:
        """Add the mesh of a node with all its transforms."""
        if placed.mesh not in self._read:
            self._read[placed.mesh] = self._primitives(placed.mesh)
        if not (np.abs(placed.transforms) < FARTHEST).all():
            self.problems.append(f"node {placed.node} has a transform without bounds")
            return
        spec = self._specs[placed.mesh] if placed.mesh < len(self._specs) else {}
        name = placed.name or (text(spec, "name") if isinstance(spec, dict) else "")
        name = name or f"node {placed.node}"
        several = len(placed.transforms) > 1
        for primitive in self._read[placed.mesh]:
            size = len(primitive.vertices if primitive.faces is None else primitive.faces)
            self._left -= max(size, 1) * len(placed.transforms)
            if self._left < 0:
                raise MalformedError(f"unfolds to more than {MOST_TRIANGLES} triangles")
            for number, transform in enumerate(placed.transforms):
                self._place(primitive, transform, f"{name} #{number}" if several else name)

    def _place(self, primitive: Primitive, transform: NDArray[np.float64], name: str) -> None:
        vertices = primitive.vertices @ transform[:3, :3].T + transform[:3, 3]
        if primitive.faces is None:
            self.clouds.append(PointCloud(vertices, primitive.colour))
            return
        faces = primitive.faces
        # A mirroring transform reverses the orientation of triangles (section 3.7.4).
        if np.linalg.det(transform[:3, :3]) < 0:
            faces = faces[:, ::-1]
        objects, names = self._objects(primitive, name)
        self.meshes.append(TriangleMesh(vertices, faces, primitive.colour, objects, names))

    def _objects(
        self, primitive: Primitive, name: str
    ) -> tuple[NDArray[np.int32], tuple[str, ...]]:
        """Return the object of each triangle and their names: ``"node / feature / material"``."""
        faces = primitive.faces
        assert faces is not None
        end = (primitive.material,) if primitive.material else ()
        if primitive.feature is None or not len(faces):
            return np.zeros(len(faces), np.int32), (" / ".join((name, *end)),)
        features, objects = np.unique(primitive.feature, return_inverse=True)
        known = self._feature_names or primitive.feature_names
        names = []
        for feature in features.tolist():
            if feature < 0:
                middle: tuple[str, ...] = ()
            elif feature < len(known) and known[feature]:
                middle = (known[feature],)
            else:
                middle = (f"feature {feature}",)
            names.append(" / ".join((name, *middle, *end)))
        return objects.reshape(-1).astype(np.int32), tuple(names)

    def _primitives(self, number: int) -> list[Primitive]:
        """Read the primitives of a mesh; an unreadable one adds a line to ``problems``."""
        spec = self._specs[number] if number < len(self._specs) else None
        if not isinstance(spec, dict):
            self.problems.append(f"mesh {number} does not exist")
            return []
        read: list[Primitive] = []
        for k, entry in enumerate(items(spec, "primitives")):
            place = f"mesh {number} ({shown(text(spec, 'name'))}), primitive {k}"
            place = place.replace(" ()", "")
            try:
                if not isinstance(entry, dict):
                    raise MalformedError("is not an object")
                primitive = self._reader.read(entry)
            except MalformedError as error:
                self.problems.append(f"{place}: {error}")
                continue
            if primitive is None:
                self.lines += 1
                continue
            if primitive.problem:
                self.problems.append(f"{place}: {primitive.problem}")
            read.append(primitive)
        return read


def shown(name: str) -> str:
    """Return a name from a file as one short line."""
    line = " ".join(name.split())
    return line if len(line) <= 80 else line[:77] + "..."


#: y-up to z-up: glTF's y axis becomes z, its z axis becomes -y.
Y_UP_TO_Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
#: Distance from the origin beyond which points are Earth-centred, metres.
EARTH_SIZE = 6.2e6


def read_gltf(data: bytes, resolve: Callable[[str], bytes], *, name: str) -> ImportedModel:
    """Read a ``.gltf`` or ``.glb``.

    Triangles (lists, strips and fans) become the mesh, an object per node, material and feature;
    points become the cloud; lines are left out and counted in ``notes``. Extensions that change
    geometry or colour: ``KHR_draco_mesh_compression``, ``EXT_meshopt_compression``,
    ``KHR_mesh_quantization``, ``EXT_mesh_gpu_instancing``, ``EXT_mesh_features``, ``CESIUM_RTC``,
    ``KHR_texture_transform``, ``EXT_texture_webp``, ``KHR_materials_pbrSpecularGlossiness``.

    Args:
        data: the bytes of the file.
        resolve: returns the bytes of a relative URI of the file; it may raise ``OSError`` or
            ``InputError``.
        name: name of the file, for errors.

    Returns:
        The model with y up and in metres, as glTF prescribes; with z up if the document states its
        centre (``CESIUM_RTC``), and in EPSG:4978 if that is on the Earth's surface.

    Raises:
        InputError: nothing can be read.
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
    return _in_place(scene, mesh, cloud, files)


def joined_clouds(clouds: tuple[PointCloud, ...]) -> PointCloud | None:
    """Return clouds as one; mid-grey if only some have colour."""
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


def _in_place(
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
