"""Triangle meshes in which every triangle has a semantic class and a material."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from urbantwin.artefact.arrays import ArrayOf, read_arrays
from urbantwin.errors import InputError
from urbantwin.geometry.pose import Pose
from urbantwin.taxonomy import GROUND_CLASSES, materials, semantic_classes, semantic_id

__all__ = ["MESH_FORM", "LabelledMesh", "checked_mesh"]

#: No site reaches further, metres.
_FURTHEST_M = 1e6
#: Number of triangles whose normals are computed together: as many as fit a cache.
_TOGETHER = 1 << 13
#: A narrower triangle is a line, which has no normal.
_THINNEST_M = 1e-9
#: The arrays of a mesh in its file.
MESH_FORM = {
    "vertices": ArrayOf("f8", ("V", 3), least=-_FURTHEST_M, most=_FURTHEST_M),
    "faces": ArrayOf("i4", ("F", 3), rows_of="V"),
    "semantic": ArrayOf("u2", ("F",)),
    "material": ArrayOf("u1", ("F",)),
    "part": ArrayOf("i4", ("F",)),
}


@dataclass(frozen=True, eq=False)
class LabelledMesh:
    """Triangles with labels.

    Attributes:
        vertices: (V, 3) float64, metres.
        faces: (F, 3) int32, indices of vertices, counter-clockwise seen from outside.
        semantic: (F,) uint16, numbers of ``urbantwin.taxonomy.semantic_classes``.
        material: (F,) uint8, numbers of ``urbantwin.taxonomy.materials``.
        part: (F,) int32, number of a triangle's object within its stage (a building, a pole); 0 for
            none.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]
    semantic: NDArray[np.uint16]
    material: NDArray[np.uint8]
    part: NDArray[np.int32]

    def __post_init__(self) -> None:
        count = len(self.faces)
        if self.vertices.ndim != 2 or self.vertices.shape[1] != 3:
            raise ValueError(f"vertices must be (V, 3), not {self.vertices.shape}")
        if self.faces.ndim != 2 or self.faces.shape[1] != 3:
            raise ValueError(f"faces must be (F, 3), not {self.faces.shape}")
        for name in ("semantic", "material", "part"):
            if getattr(self, name).shape != (count,):
                raise ValueError(f"{name} must be ({count},), not {getattr(self, name).shape}")

    @classmethod
    def build(
        cls,
        vertices: ArrayLike,
        faces: ArrayLike,
        semantic: ArrayLike,
        material: ArrayLike,
        part: ArrayLike = 0,
    ) -> LabelledMesh:
        """Build from array-like values; a single number is used as the label of all triangles."""
        triangles = np.asarray(faces, np.int32).reshape(-1, 3)
        count = len(triangles)
        return cls(
            np.asarray(vertices, np.float64).reshape(-1, 3),
            triangles,
            np.broadcast_to(np.asarray(semantic, np.uint16), (count,)).copy(),
            np.broadcast_to(np.asarray(material, np.uint8), (count,)).copy(),
            np.broadcast_to(np.asarray(part, np.int32), (count,)).copy(),
        )

    @classmethod
    def empty(cls) -> LabelledMesh:
        """Return a mesh without triangles."""
        return cls.build(np.zeros((0, 3)), np.zeros((0, 3)), 0, 0)

    @classmethod
    def concatenate(cls, meshes: Iterable[LabelledMesh]) -> LabelledMesh:
        """Join meshes; ``part`` numbers are not changed."""
        parts = [mesh for mesh in meshes if len(mesh.faces)]
        if not parts:
            return cls.empty()
        starts = np.cumsum([0] + [len(mesh.vertices) for mesh in parts[:-1]])
        return cls(
            np.concatenate([mesh.vertices for mesh in parts]),
            np.concatenate(
                [mesh.faces + np.int32(start) for mesh, start in zip(parts, starts, strict=True)]
            ),
            np.concatenate([mesh.semantic for mesh in parts]),
            np.concatenate([mesh.material for mesh in parts]),
            np.concatenate([mesh.part for mesh in parts]),
        )

    def transformed(self, pose: Pose) -> LabelledMesh:
        """Return the mesh moved by a rigid transform."""
        return LabelledMesh(
            pose.apply(self.vertices), self.faces, self.semantic, self.material, self.part
        )

    def triangles(self) -> NDArray[np.float64]:
        """Return the corner positions (F, 3, 3)."""
        return self.vertices.take(self.faces, axis=0)  # many times faster than by an index

    def normals(self, which: NDArray[np.integer[Any]] | None = None) -> NDArray[np.float64]:
        """Return unit normals (N, 3) of the triangles ``which`` (N,), or of all (F, 3).

        They are zero if a triangle is narrower than a nanometre: for a line or a point, the cross
        product of its edges is only rounding error.
        """
        faces = self.faces if which is None else self.faces.take(which, axis=0)
        vertices = np.ascontiguousarray(self.vertices.T)
        normals = np.empty((len(faces), 3))
        # In batches: allocating memory for all at once takes several times as long.
        for start in range(0, len(faces), _TOGETHER):
            # By coordinate: `np.cross` and sums over three take several times as long.
            some = slice(start, start + _TOGETHER)
            of_corners = vertices[:, np.ascontiguousarray(faces[some].T)]
            first = of_corners[:, 0]
            (ux, uy, uz), (vx, vy, vz) = of_corners[:, 1] - first, of_corners[:, 2] - first
            cross = np.array([uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx])
            length = np.sqrt(cross[0] * cross[0] + cross[1] * cross[1] + cross[2] * cross[2])
            edges = abs(ux) + abs(uy) + abs(uz) + abs(vx) + abs(vy) + abs(vz)
            wide = length > _THINNEST_M * edges
            cross[:, ~wide] = 0.0
            np.divide(cross, length, out=cross, where=wide)
            normals[some] = cross.T
        return normals

    def areas(self) -> NDArray[np.float64]:
        """Return areas (F,) in square metres."""
        a, b, c = np.moveaxis(self.triangles(), 1, 0)
        return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2)

    @property
    def is_ground(self) -> NDArray[np.bool_]:
        """Which triangles (F,) are of a class of ground (`taxonomy.GROUND_CLASSES`)."""
        return np.isin(self.semantic, [semantic_id(name) for name in GROUND_CLASSES])

    def select(self, keep: NDArray[np.bool_]) -> LabelledMesh:
        """Return the triangles where ``keep`` (F,) is true, without unused vertices."""
        faces = self.faces[keep]
        used = np.zeros(len(self.vertices), np.bool_)
        used[faces] = True
        number = np.cumsum(used, dtype=np.int32) - np.int32(1)
        return LabelledMesh(
            self.vertices[used],
            number.take(faces),
            self.semantic[keep],
            self.material[keep],
            self.part[keep],
        )

    def save(self, path: Path) -> None:
        """Write a ``.npz``; the same mesh gives the same bytes."""
        np.savez_compressed(
            path,
            vertices=self.vertices,
            faces=self.faces,
            semantic=self.semantic,
            material=self.material,
            part=self.part,
        )

    @classmethod
    def load(cls, path: Path) -> LabelledMesh:
        """Read a file written by ``save``.

        Raises:
            InputError: the file is missing or damaged, or its labels are unknown.
        """
        expected = "a mesh with labels"
        return cls(**checked_mesh(read_arrays(path, expected, MESH_FORM), path, expected))


def checked_mesh(arrays: dict[str, NDArray[Any]], file: Path, expected: str) -> dict[str, Any]:
    """Return the arrays of a mesh after a check of its labels against the tables.

    Raises:
        InputError: a label is not in its table.
    """
    for name, known in (("semantic", semantic_classes()), ("material", materials())):
        numbers = {entry.id for entry in known.values()}
        strange = set(np.flatnonzero(np.bincount(arrays[name])).tolist()) - numbers
        if strange:
            raise InputError(
                f"holds {min(strange)}, which is not in its table",
                file=file,
                place=name,
                expected=expected,
            )
    return arrays
