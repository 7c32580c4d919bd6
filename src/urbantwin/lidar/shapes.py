"""Meshes made ready for rays: an actor's, in the frame of its asset, or the static world's."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from threading import Lock
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from urbantwin.geometry import LabelledMesh
from urbantwin.lidar.casting import EmbreeCaster
from urbantwin.lidar.casting.warp_layers import WarpLayers
from urbantwin.taxonomy import materials

__all__ = ["ActorShape", "MeshSource", "ShapeArrays", "ShapeTable"]

#: Gives the mesh of an asset in a gait phase, in the asset's frame.
MeshSource = Callable[[str, int], LabelledMesh]


class ActorShape:
    """A mesh with its tree for rays. All in the mesh's own frame, metres.

    Attributes:
        caster: its ray tracing structure.
        low: (3,) lower corner of its bounds.
        high: (3,) upper corner of its bounds.
        hull: (3, H) vertices of its convex hull: the only ones that can touch a bound of the
            mesh, however it is turned.
        normals: (F, 3) float64 unit normals.
        offsets: (F,) float64, where the triangles' planes lie along their normals.
        material: (F,) uint8.
        panes: (F,) bool, triangles that let light through.
    """

    def __init__(self, mesh: LabelledMesh, *, with_hull: bool = True) -> None:
        used = mesh.vertices[np.unique(mesh.faces)] if len(mesh.faces) else np.zeros((1, 3))
        self.caster = EmbreeCaster(mesh.vertices, mesh.faces)
        self.low, self.high = used.min(axis=0), used.max(axis=0)
        if with_hull:
            with suppress(QhullError):  # A flat mesh has no volume.
                used = used[ConvexHull(used).vertices]
        else:
            used = np.stack([self.low, self.high])
        self.hull = np.ascontiguousarray(used.T)
        self.normals = mesh.normals()
        self.offsets = (self.normals * mesh.vertices[mesh.faces[:, 0]]).sum(axis=1)
        self.material = mesh.material
        clear = np.array([one.transmission > 0 for one in materials().values()])
        self.panes = clear[mesh.material]


class ShapeArrays(NamedTuple):
    """Shapes end to end, as compiled code takes them.

    Attributes:
        scenes: (S,) uint64, Embree's scene of each shape.
        first_face: (S,) int64, where the faces of each begin below.
        normals: (F, 3) float64.
        offsets: (F,) float64.
        panes: (F,) bool.
        vertices: (V, 3) float64.
        corners: (F, 3) int32, of the triangles among the vertices.
        material: (F,) uint8.
        hull: (3, H) float64, vertices of the convex hulls.
        first_hull: (S,) int64, where the vertices of each begin.
        hull_size: (S,) int64, how many it has.
        low: (S, 3) float64, lower corners of the bounds.
        high: (S, 3) float64, upper corners.
        meshes: vertices (V, 3) and faces (F, 3) of each shape, alone.
        device: where rays are cast at them; ``None``: on the processor, by Embree.
    """

    scenes: NDArray[np.uint64]
    first_face: NDArray[np.int64]
    normals: NDArray[np.float64]
    offsets: NDArray[np.float64]
    panes: NDArray[np.bool_]
    vertices: NDArray[np.float64]
    corners: NDArray[np.int32]
    material: NDArray[np.uint8]
    hull: NDArray[np.float64]
    first_hull: NDArray[np.int64]
    hull_size: NDArray[np.int64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    meshes: tuple[tuple[NDArray[np.float64], NDArray[np.int32]], ...] = ()
    device: WarpLayers | None = None

    @classmethod
    def of(cls, shapes: list[ActorShape], device: WarpLayers | None = None) -> ShapeArrays:
        """Put shapes end to end."""
        count = [len(shape.material) for shape in shapes]
        corners = [shape.hull.shape[1] for shape in shapes]
        first = np.cumsum([0, *(len(shape.caster.vertices) for shape in shapes)])
        return cls(
            np.array([shape.caster.scene for shape in shapes], np.uint64),
            np.cumsum([0, *count[:-1]], dtype=np.int64)[: len(shapes)],
            np.concatenate([shape.normals for shape in shapes]),
            np.concatenate([shape.offsets for shape in shapes]),
            np.concatenate([shape.panes for shape in shapes]),
            np.concatenate([shape.caster.vertices for shape in shapes]),
            np.concatenate(
                [
                    shape.caster.faces + np.int32(before)
                    for shape, before in zip(shapes, first[:-1], strict=True)
                ]
            ),
            np.concatenate([shape.material for shape in shapes]),
            np.concatenate([shape.hull for shape in shapes], axis=1),
            np.cumsum([0, *corners[:-1]], dtype=np.int64)[: len(shapes)],
            np.array(corners, np.int64),
            np.array([shape.low for shape in shapes]),
            np.array([shape.high for shape in shapes]),
            tuple((shape.caster.vertices, shape.caster.faces) for shape in shapes),
            device,
        )


class ShapeTable:
    """Every shape that was asked for so far, by asset and gait phase.

    Args:
        meshes: gives the mesh of an asset.
        device: where rays are cast at them, see `ShapeArrays`.
    """

    def __init__(self, meshes: MeshSource, device: WarpLayers | None = None) -> None:
        self._meshes, self._device = meshes, device
        self._number: dict[tuple[str, int], int] = {}
        self._shapes: list[ActorShape] = []
        self._arrays: ShapeArrays | None = None
        self._lock = Lock()

    def number(self, asset: str, phase: int) -> int:
        """Return the number of a shape, which is made when it is first asked for."""
        key = (asset, phase)
        if key not in self._number:
            with self._lock:  # Frames may be scanned by several threads.
                if key not in self._number:
                    self._shapes.append(ActorShape(self._meshes(asset, phase)))
                    self._arrays = None
                    self._number[key] = len(self._shapes) - 1
        return self._number[key]

    def __getitem__(self, number: int) -> ActorShape:
        return self._shapes[number]

    @property
    def arrays(self) -> ShapeArrays:
        """All shapes end to end."""
        with self._lock:
            if self._arrays is None:
                self._arrays = ShapeArrays.of(self._shapes, self._device)
            return self._arrays
