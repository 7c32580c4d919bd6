"""A whole glTF document as meshes and points in its scene's frame."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.reconstruct.gltf.buffers import Buffers
from urbantwin.reconstruct.gltf.container import open_container
from urbantwin.reconstruct.gltf.nodes import PlacedMesh, placed_meshes
from urbantwin.reconstruct.gltf.primitive import FARTHEST, Primitive, PrimitiveReader
from urbantwin.reconstruct.gltf.untrusted_values import MalformedError, items, numbers, table, text
from urbantwin.reconstruct.model import PointCloud, TriangleMesh

__all__ = ["MOST_TRIANGLES", "Scene", "read_scene", "shown"]

#: Triangles (and points) that one document may unfold to, instances included.
MOST_TRIANGLES = 20_000_000


@dataclass(frozen=True, eq=False)
class Scene:
    """What a document shows.

    Attributes:
        meshes: one per primitive and instance; y up.
        clouds: primitives of points; y up.
        centre: (3,) added after the turn to z up (``CESIUM_RTC``), or ``None``.
        problems: what was left out, a line each.
        copyright: who made it, as the document says.
        skipped: counts of what carries no surface, by name.
    """

    meshes: tuple[TriangleMesh, ...]
    clouds: tuple[PointCloud, ...]
    centre: NDArray[np.float64] | None
    problems: tuple[str, ...]
    copyright: str
    skipped: dict[str, int]


@np.errstate(all="ignore")  # what is not a number is looked for, and told
def read_scene(
    data: bytes, resolve: Callable[[str], bytes], *, feature_names: Sequence[str] = ()
) -> Scene:
    """Read a glTF document.

    Args:
        data: the bytes of a ``.gltf`` or ``.glb``.
        resolve: gives the bytes of a relative URI; it may raise ``OSError`` or ``InputError``.
        feature_names: names of features by number, where something outside of the document
            (a batch table) says them.

    Raises:
        MalformedError: nothing of it can be read.
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
        """Add the mesh of a node at all its places."""
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
        # A transform that mirrors turns triangles inside out (section 3.7.4).
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
        """Read the primitives of a mesh; one that cannot be read is a line of ``problems``."""
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
    """Return a name of a file as one short line."""
    line = " ".join(name.split())
    return line if len(line) <= 80 else line[:77] + "..."
