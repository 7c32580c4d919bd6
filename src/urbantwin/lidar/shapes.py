"""Shapes for ray casting: meshes of actors, in their assets' frames, and of the static world."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import product
from threading import Lock
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from urbantwin.geometry import LabelledMesh
from urbantwin.geometry.rays import RayScene
from urbantwin.lidar.actor_path import Paths
from urbantwin.taxonomy import materials

__all__ = [
    "PLANE",
    "ActorShape",
    "MeshSource",
    "PresentActors",
    "ShapeTable",
    "Shapes",
    "Triangles",
]

#: Returns the mesh of an asset in a gait phase, asset frame.
MeshSource = Callable[[str, int], LabelledMesh]

#: Plane of a triangle: unit normal, offset along it, metres, and whether the triangle is
#: transparent.
PLANE = np.dtype([(name, np.float64) for name in ("x", "y", "z", "offset")] + [("pane", np.bool_)])

#: Directions to the sides, edges and corners of a cube (26, 3).
_DIRECTIONS = np.array([one for one in product((-1.0, 0.0, 1.0), repeat=3) if any(one)])
#: Vertices deeper inside the hull cannot touch a bound: more than rounding errors, metres.
_WITHIN_M = 1e-9


class ActorShape:
    """A mesh with its tree for ray casting, in the mesh's own frame, metres.

    Attributes:
        scene: triangles for ray casting.
        low: (3,) lower corner of its bounds.
        high: (3,) upper corner of its bounds.
        hull: (3, H) vertices that can touch a bound of the rotated mesh, and a few others.
        planes: (F,) records `PLANE` of its triangles.
        material: (F,) uint8.
    """

    def __init__(
        self, mesh: LabelledMesh, *, with_hull: bool = True, library: str | None = None
    ) -> None:
        used = np.zeros((3, 1))
        if len(mesh.faces):
            used = mesh.vertices.T[:, np.flatnonzero(np.bincount(mesh.faces.ravel()))]
        self.scene = RayScene(mesh.vertices, mesh.faces, many_rays=True, library=library)
        self.low, self.high = used.min(axis=1), used.max(axis=1)
        self.hull = _outer_vertices(used) if with_hull else np.stack([self.low, self.high], axis=1)
        self.material = mesh.material
        normals = mesh.normals().T
        reach = normals * mesh.vertices.T[:, mesh.faces[:, 0]]
        clear = _lets_light_through()
        self.planes = np.zeros(len(mesh.faces), PLANE)
        self.planes["x"], self.planes["y"], self.planes["z"] = normals
        self.planes["offset"] = reach[0] + reach[1] + reach[2]
        self.planes["pane"] = clear[mesh.material]


def _outer_vertices(vertices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the vertices (3, H) outside the hull of the 26 extreme ones.

    They include the vertices of the convex hull. The full hull would leave a third as many and take
    four times as long.
    """
    vertices = np.ascontiguousarray(vertices)
    outermost = np.unique((_DIRECTIONS @ vertices).argmax(axis=1))
    try:
        sides = ConvexHull(vertices[:, outermost].T).equations
    except QhullError:  # a flat mesh has no volume
        return vertices
    outside = (sides[:, :3] @ vertices + sides[:, 3:]).max(axis=0)
    return np.ascontiguousarray(vertices[:, outside > -_WITHIN_M])


@cache
def _lets_light_through() -> NDArray[np.bool_]:
    """Return whether each material, by its id, is transparent."""
    return np.array([material.transmission > 0 for material in materials().values()])


class Triangles(NamedTuple):
    """Triangles of several shapes, concatenated, as compiled code takes them.

    Attributes:
        planes: (F,) records `PLANE`.
        vertices: (V, 3) float64.
        corners: (F, 3) int32, vertex indices.
    """

    planes: NDArray[np.void]
    vertices: NDArray[np.float64]
    corners: NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class Shapes:
    """S shapes, concatenated.

    Attributes:
        scenes: triangles of each shape, for ray casting.
        first_face: (S,) int64, index of each shape's first face.
        triangles: triangles of all shapes.
        material: (F,) uint8.
        hull: x, y and z (H,) float64 of vertices that can touch a bound.
        first_hull: (S,) int64, index of each shape's first hull vertex.
        hull_size: (S,) int64, number of hull vertices.
        low: (S, 3) float64, lower corners of the bounds.
        high: (S, 3) float64, upper corners.
    """

    scenes: tuple[RayScene, ...]
    first_face: NDArray[np.int64]
    triangles: Triangles
    material: NDArray[np.uint8]
    hull: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
    first_hull: NDArray[np.int64]
    hull_size: NDArray[np.int64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]

    @classmethod
    def of(cls, shapes: Sequence[ActorShape]) -> Shapes:
        """Concatenate shapes."""
        rows = _Rows()
        for shape in shapes:
            rows.append(shape)
        return rows.shapes()


class _Column:
    """An array that grows at its end; rows returned before stay unchanged."""

    def __init__(self, none: NDArray[Any]) -> None:
        self._room = none
        self.length = 0

    def append(self, values: NDArray[Any]) -> None:
        """Append rows."""
        until = self.length + len(values)
        if until > len(self._room):
            room = np.empty((max(until, 2 * len(self._room)), *values.shape[1:]), self._room.dtype)
            room[: self.length] = self._room[: self.length]
            self._room = room
        self._room[self.length : until] = values
        self.length = until

    def rows(self) -> NDArray[Any]:
        """Return all rows."""
        return self._room[: self.length]


class _Rows:
    """Concatenated shapes to which more can be added without copying all."""

    def __init__(self) -> None:
        self._scenes: list[RayScene] = []
        self._planes = _Column(np.zeros(0, PLANE))
        self._vertices = _Column(np.zeros((0, 3)))
        self._corners = _Column(np.zeros((0, 3), np.int32))
        self._material = _Column(np.zeros(0, np.uint8))
        self._hull = tuple(_Column(np.zeros(0)) for _ in range(3))
        self._first_face, self._first_hull, self._hull_size = (
            _Column(np.zeros(0, np.int64)) for _ in range(3)
        )
        self._low, self._high = (_Column(np.zeros((0, 3))) for _ in range(2))

    def append(self, shape: ActorShape) -> None:
        """Append a shape."""
        self._first_face.append(np.array([self._material.length]))
        self._first_hull.append(np.array([self._hull[0].length]))
        self._hull_size.append(np.array([shape.hull.shape[1]]))
        self._low.append(shape.low[None])
        self._high.append(shape.high[None])
        self._scenes.append(shape.scene)
        self._corners.append(shape.scene.faces + np.int32(self._vertices.length))
        self._planes.append(shape.planes)
        self._vertices.append(shape.scene.vertices)
        self._material.append(shape.material)
        for axis, column in enumerate(self._hull):
            column.append(shape.hull[axis])

    def shapes(self) -> Shapes:
        """Return all shapes."""
        x, y, z = (column.rows() for column in self._hull)
        return Shapes(
            tuple(self._scenes),
            self._first_face.rows(),
            Triangles(self._planes.rows(), self._vertices.rows(), self._corners.rows()),
            self._material.rows(),
            (x, y, z),
            self._first_hull.rows(),
            self._hull_size.rows(),
            self._low.rows(),
            self._high.rows(),
        )


@dataclass(frozen=True, eq=False)
class PresentActors:
    """The actors of a frame.

    Attributes:
        shapes: all shapes.
        shape: (A,) int64, shape of each actor.
        paths: paths of the actors.
    """

    shapes: Shapes
    shape: NDArray[np.int64]
    paths: Paths

    @cached_property
    def low(self) -> NDArray[np.float64]:
        """Lower corners (A, 3) of the actors' bounds, asset frame."""
        return np.asarray(self.shapes.low[self.shape])

    @cached_property
    def high(self) -> NDArray[np.float64]:
        """Upper corners (A, 3)."""
        return np.asarray(self.shapes.high[self.shape])

    def only(self, actors: NDArray[np.int64]) -> PresentActors:
        """Return the actors of some indices."""
        paths = Paths(*(part[actors] for part in self.paths))
        return PresentActors(self.shapes, self.shape[actors], paths)

    def material(self, actor: NDArray[np.int32], face: NDArray[np.int32]) -> NDArray[np.uint8]:
        """Return the material (L,) of faces (L,) of actors (L,)."""
        first = self.shapes.first_face[self.shape]
        return self.shapes.material.take(first.take(actor) + face)


class ShapeTable:
    """All shapes used so far, by asset and gait phase.

    Args:
        meshes: returns the mesh of an asset.
        library: ray tracing library, see `RayScene`.
    """

    def __init__(self, meshes: MeshSource, library: str | None = None) -> None:
        self._meshes = meshes
        self._library = library
        self._number: dict[tuple[str, int], int] = {}
        self._shapes: list[ActorShape] = []
        self._rows = _Rows()
        self._arrays: Shapes | None = None
        self._lock = Lock()

    def number(self, asset: str, phase: int) -> int:
        """Return the index of a shape, which is built at first use."""
        key = (asset, phase)
        if key not in self._number:
            with self._lock:  # several threads may scan frames
                if key not in self._number:
                    shape = ActorShape(self._meshes(asset, phase), library=self._library)
                    self._shapes.append(shape)
                    self._rows.append(shape)
                    self._arrays = None
                    self._number[key] = len(self._shapes) - 1
        return self._number[key]

    def __getitem__(self, number: int) -> ActorShape:
        return self._shapes[number]

    @property
    def arrays(self) -> Shapes:
        """All shapes, concatenated."""
        with self._lock:
            if self._arrays is None:
                self._arrays = self._rows.shapes()
            return self._arrays
