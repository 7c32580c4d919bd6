"""An imported model: triangles and points in its own frame, with metadata of its file."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS

__all__ = ["Geotag", "ImportedModel", "PointCloud", "TriangleMesh"]


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """Triangles without labels.

    Attributes:
        vertices: (V, 3) float64, in the model's own frame and unit.
        faces: (F, 3) int32, indices of vertices, counter-clockwise seen from outside.
        colour: (F, 3) uint8 sRGB: the mean of texture, vertex or material colour over each
            triangle; ``None`` if the file has none.
        object: (F,) int32, index in ``names`` of each triangle's object (node, tile, building).
        names: names of the objects in the file: ``"building 12 / Roof"``, ``"asphalt"``.
        semantic: (F,) uint16 ids of ``taxonomy.semantic_classes`` if the file has labels
            (CityJSON), 0 if unlabelled; ``None`` without labels.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]
    colour: NDArray[np.uint8] | None
    object: NDArray[np.int32]
    names: tuple[str, ...]
    semantic: NDArray[np.uint16] | None = None

    def __post_init__(self) -> None:
        count = len(self.faces)
        if self.vertices.ndim != 2 or self.vertices.shape[1] != 3:
            raise ValueError(f"vertices must be (V, 3), not {self.vertices.shape}")
        if self.faces.ndim != 2 or self.faces.shape[1] != 3:
            raise ValueError(f"faces must be (F, 3), not {self.faces.shape}")
        if self.object.shape != (count,):
            raise ValueError(f"object must be ({count},), not {self.object.shape}")

    @classmethod
    def build(
        cls,
        vertices: NDArray[np.float64],
        faces: NDArray[np.int32],
        *,
        colour: NDArray[np.uint8] | None = None,
        name: str = "",
        semantic: NDArray[np.uint16] | None = None,
    ) -> TriangleMesh:
        """Return a mesh of one object."""
        triangles = np.asarray(faces, np.int32).reshape(-1, 3)
        return cls(
            np.asarray(vertices, np.float64).reshape(-1, 3),
            triangles,
            colour,
            np.zeros(len(triangles), np.int32),
            (name,),
            semantic,
        )

    @classmethod
    def concatenate(cls, meshes: Iterable[TriangleMesh]) -> TriangleMesh:
        """Join meshes, with separate objects. Missing colours become mid-grey."""
        parts = [mesh for mesh in meshes if len(mesh.faces)]
        if not parts:
            return cls.build(np.zeros((0, 3)), np.zeros((0, 3), np.int32))
        vertex = np.cumsum([0] + [len(mesh.vertices) for mesh in parts[:-1]])
        number = np.cumsum([0] + [len(mesh.names) for mesh in parts[:-1]])
        colour = None
        if any(mesh.colour is not None for mesh in parts):
            colour = np.concatenate(
                [
                    np.full((len(m.faces), 3), 128, np.uint8) if m.colour is None else m.colour
                    for m in parts
                ]
            )
        semantic = None
        if any(mesh.semantic is not None for mesh in parts):
            semantic = np.concatenate(
                [
                    np.zeros(len(m.faces), np.uint16) if m.semantic is None else m.semantic
                    for m in parts
                ]
            )
        return cls(
            np.concatenate([mesh.vertices for mesh in parts]),
            np.concatenate([m.faces + np.int32(k) for m, k in zip(parts, vertex, strict=True)]),
            colour,
            np.concatenate([m.object + np.int32(k) for m, k in zip(parts, number, strict=True)]),
            tuple(name for mesh in parts for name in mesh.names),
            semantic,
        )

    def select(self, keep: NDArray[np.bool_]) -> TriangleMesh:
        """Return the triangles with a true ``keep`` (F,), without unused vertices."""
        used, faces = np.unique(self.faces[keep], return_inverse=True)
        return TriangleMesh(
            self.vertices[used],
            faces.reshape(-1, 3).astype(np.int32),
            None if self.colour is None else self.colour[keep],
            self.object[keep],
            self.names,
            None if self.semantic is None else self.semantic[keep],
        )

    def triangles(self) -> NDArray[np.float64]:
        """Return the corner positions (F, 3, 3)."""
        return self.vertices[self.faces]


@dataclass(frozen=True, eq=False)
class PointCloud:
    """Points of a survey.

    Attributes:
        points: (N, 3) float64, in the model's own frame and unit.
        colour: (N, 3) uint8 sRGB, or ``None``.
        classification: (N,) uint8, classes of ASPRS LAS 1.4 (2 ground, 3-5 vegetation, 6 building,
            7 noise, 9 water), or ``None`` if the file has none.
        last: (N,) bool, whether a point is its pulse's last return, or ``None``.
    """

    points: NDArray[np.float64]
    colour: NDArray[np.uint8] | None = None
    classification: NDArray[np.uint8] | None = None
    last: NDArray[np.bool_] | None = None

    def select(self, keep: NDArray[np.bool_]) -> PointCloud:
        """Return the points with a true ``keep`` (N,)."""
        return PointCloud(
            self.points[keep],
            None if self.colour is None else self.colour[keep],
            None if self.classification is None else self.classification[keep],
            None if self.last is None else self.last[keep],
        )

    @classmethod
    def concatenate(cls, clouds: Sequence[PointCloud]) -> PointCloud:
        """Join clouds; an attribute that one of them lacks is dropped."""
        return cls(
            np.concatenate([cloud.points for cloud in clouds]),
            _joined([cloud.colour for cloud in clouds]),
            _joined([cloud.classification for cloud in clouds]),
            _joined([cloud.last for cloud in clouds]),
        )


def _joined(columns: Sequence[NDArray[Any] | None]) -> NDArray[Any] | None:
    known = [column for column in columns if column is not None]
    return np.concatenate(known) if len(known) == len(columns) else None


@dataclass(frozen=True)
class Geotag:
    """Location of a local model's origin as stated in its file; heights may have any datum.

    Attributes:
        latitude: degrees, WGS84.
        longitude: degrees, WGS84.
        height_m: metres; ``None`` if not stated.
        heading_deg: heading of the model's +y axis, clockwise from north.
        height_datum: ``"ellipsoidal"``, a CRS's name, or ``""`` if not stated.
    """

    latitude: float
    longitude: float
    height_m: float | None = None
    heading_deg: float = 0.0
    height_datum: str = ""


@dataclass(frozen=True, eq=False)
class ImportedModel:
    """The contents of one source.

    Attributes:
        mesh: its triangles, or ``None``.
        cloud: its points, or ``None``.
        crs: CRS of its coordinates as stated in the file, possibly three-dimensional (tiles:
            EPSG:4978), or ``None``.
        up: its up axis, ``"y"`` or ``"z"``; ``None`` if the format leaves it open.
        unit_m: length of its unit in metres; ``None`` if the format leaves it open.
        geotag: location of its origin as stated in the file, or ``None``.
        problems: unreadable parts that were left out, a line each.
        notes: statistics for reports: counts by name.
        files: names of the files that were read, with their SHA-256.
    """

    mesh: TriangleMesh | None = None
    cloud: PointCloud | None = None
    crs: CRS | None = None
    up: str | None = None
    unit_m: float | None = None
    geotag: Geotag | None = None
    problems: tuple[str, ...] = ()
    notes: dict[str, object] = field(default_factory=dict)
    files: dict[str, str] = field(default_factory=dict)
