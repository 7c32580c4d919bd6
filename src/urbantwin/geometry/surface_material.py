"""Materials of the ground finer than its triangles: sparse rasters of single bits.

A layer gives the area of one material: tiles of 64 x 64 cells on a grid through the site frame's
origin, eight cells per byte, and only tiles that are not empty. So the lane markings of a district
take a few megabytes, and areas without paint take no memory. Each tile has the height of its
surface, so that paint on a bridge is not on the street below.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from urbantwin.artefact.arrays import ArrayOf, read_arrays
from urbantwin.errors import InputError
from urbantwin.geometry.mesh import LabelledMesh
from urbantwin.taxonomy import GROUND_CLASSES, materials, semantic_id

__all__ = ["TILE", "MaterialLayer", "SurfaceMaterials", "taking"]

#: Cells along a tile's side.
TILE = 64
#: Maximum vertical distance of a point from a tile's surface for being on it, metres: less than the
#: clearance under a bridge, more than a surface deviates from the bilinear surface of its tile's
#: corners.
REACH_M = 1.5
_EXPECTED = "a twin's materials of the ground"
#: Cells are no larger, metres, and no tile is further from the origin.
_LARGEST, _FURTHEST = 1000.0, 1 << 24
#: The arrays in their file: L layers, and the tiles of all layers in sequence.
_FORM = {
    "material": ArrayOf("u1", ("L",)),
    "level": ArrayOf("i4", ("L",)),
    "cell_m": ArrayOf("f8", ("L",), least=1e-4, most=_LARGEST),
    "count": ArrayOf("i8", ("L",), least=0, most=1 << 40),
    "tiles": ArrayOf("i4", ("T", 2), least=-_FURTHEST, most=_FURTHEST),
    "bits": ArrayOf("u1", ("T", TILE, TILE // 8)),
    "heights": ArrayOf("f4", ("T", 2, 2)),
}
#: Triangles steeper than this (cosine to the vertical) are walls, curbs and banks.
UP = 0.5


@dataclass(frozen=True, eq=False)
class MaterialLayer:
    """Area of one material, on one level.

    Attributes:
        material: its number.
        level: 0 on the ground, 1, 2, ... above other roads.
        cell_m: side of a cell, metres.
        tiles: (T, 2) int32, column and row of each tile, sorted by row and then by column: tile (c,
            r) covers x from c to c + 1 times ``TILE`` cells.
        bits: (T, TILE, TILE / 8) uint8, rows from south to north, columns from west to east, the
            first cell in a byte's highest bit.
        heights: (T, 2, 2) float32, metres, height of the surface at the tile's corners: row south
            then north, column west then east.
    """

    material: int
    level: int
    cell_m: float
    tiles: NDArray[np.int32]
    bits: NDArray[np.uint8]
    heights: NDArray[np.float32]

    @cached_property
    def _keys(self) -> NDArray[np.int64]:
        return _key(self.tiles[:, 0], self.tiles[:, 1])

    @property
    def area(self) -> float:
        """Covered area, square metres."""
        return float(np.unpackbits(self.bits).sum()) * self.cell_m**2

    def covers(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which points (N, 2) or (N, 3) have the material; with z, only on its surface."""
        found = np.zeros(len(points), bool)
        if not len(self.tiles) or not len(points):
            return found
        cell = np.floor(points[:, :2] / self.cell_m).astype(np.int64)
        tile = cell // TILE
        key = _key(tile[:, 0], tile[:, 1])
        at = np.minimum(np.searchsorted(self._keys, key), len(self._keys) - 1)
        here = np.flatnonzero(self._keys[at] == key)
        at, within = at[here], cell[here] - tile[here] * TILE
        byte = self.bits[at, within[:, 1], within[:, 0] >> 3]
        hit = (byte >> (7 - (within[:, 0] & 7)).astype(np.uint8)) & 1 == 1
        if points.shape[1] == 3:
            share = points[here, :2] / (self.cell_m * TILE) - tile[here]
            east, north = share[:, 0], share[:, 1]
            corner = self.heights[at]
            south = corner[:, 0, 0] * (1 - east) + corner[:, 0, 1] * east
            top = corner[:, 1, 0] * (1 - east) + corner[:, 1, 1] * east
            hit &= np.abs(points[here, 2] - (south * (1 - north) + top * north)) <= REACH_M
        found[here] = hit
        return found


def _key(column: NDArray[np.integer], row: NDArray[np.integer]) -> NDArray[np.int64]:
    return (row.astype(np.int64) << 32) + column.astype(np.int64)


@dataclass(frozen=True, eq=False)
class SurfaceMaterials:
    """Finer materials that replace those of the ground's triangles.

    Attributes:
        layers: if two layers cover a point, the first one counts.
    """

    layers: tuple[MaterialLayer, ...] = ()

    def at(self, points: ArrayLike) -> NDArray[np.uint8]:
        """Return the number of the material at points (N, 2) or (N, 3); 0 for the triangle's own.

        Args:
            points: site frame, metres; without z, on any level.
        """
        places = np.asarray(points, np.float64)
        found = np.zeros(len(places), np.uint8)
        rest = np.arange(len(places))
        for layer in self.layers:
            covered = layer.covers(places[rest])
            found[rest[covered]] = layer.material
            rest = rest[~covered]
        return found

    def materials_of(
        self, mesh: LabelledMesh, face: NDArray[np.integer], points: NDArray[np.float64]
    ) -> NDArray[np.uint8]:
        """Return the materials (N,) of hits of rays on a mesh.

        Only triangles of the ground that face up have finer materials.

        Args:
            mesh: the static scene, site frame.
            face: (N,) the triangle that was hit.
            points: (N, 3) positions of the hits, site frame, metres.
        """
        material: NDArray[np.uint8] = mesh.material[face]
        if not self.layers:
            return material
        which = np.flatnonzero(taking(mesh, face))
        own = self.at(points[which])
        material[which] = np.where(own > 0, own, material[which])
        return material

    def save(self, path: Path) -> None:
        """Write a ``.npz``; the same materials give the same bytes."""
        np.savez_compressed(
            path,
            material=np.array([layer.material for layer in self.layers], np.uint8),
            level=np.array([layer.level for layer in self.layers], np.int32),
            cell_m=np.array([layer.cell_m for layer in self.layers], np.float64),
            count=np.array([len(layer.tiles) for layer in self.layers], np.int64),
            tiles=_joined([layer.tiles for layer in self.layers], (0, 2), np.int32),
            bits=_joined([layer.bits for layer in self.layers], (0, TILE, TILE // 8), np.uint8),
            heights=_joined([layer.heights for layer in self.layers], (0, 2, 2), np.float32),
        )

    @classmethod
    def load(cls, path: Path) -> SurfaceMaterials:
        """Read a file written by ``save``.

        Raises:
            InputError: the file is missing or damaged, or its materials or tiles are not valid.
        """
        data = read_arrays(path, _EXPECTED, _FORM)
        counts = data["count"]
        if sum(counts.tolist()) != len(data["tiles"]):
            raise InputError("is not of its tiles", file=path, place="count", expected=_EXPECTED)
        known = {entry.id for entry in materials().values()}
        if not set(data["material"].tolist()) <= known:
            raise InputError(
                "names an unknown material", file=path, place="material", expected="known materials"
            )
        ends = np.cumsum(counts)
        parts = [
            np.split(data[name], ends[:-1]) if len(ends) else []
            for name in ("tiles", "bits", "heights")
        ]
        heads = zip(data["material"], data["level"], data["cell_m"], *parts, strict=True)
        layers = tuple(
            MaterialLayer(int(material), int(level), float(cell), tiles, bits, heights)
            for material, level, cell, tiles, bits, heights in heads
        )
        if any((np.diff(layer._keys) <= 0).any() for layer in layers):
            raise InputError("are not sorted", file=path, place="tiles", expected=_EXPECTED)
        return cls(layers)


def taking(mesh: LabelledMesh, face: NDArray[np.integer]) -> NDArray[np.bool_]:
    """Return which faces (N,) of a mesh can have finer materials: ground, facing up."""
    takes = np.isin(mesh.semantic[face], [semantic_id(name) for name in GROUND_CLASSES])
    ground = np.flatnonzero(takes)
    a, b, c = np.moveaxis(mesh.vertices.take(mesh.faces.take(face[ground], axis=0), axis=0), 1, 0)
    normal = np.cross(b - a, c - a)
    takes[ground] = normal[:, 2] > UP * np.linalg.norm(normal, axis=1)
    return takes


def _joined(
    arrays: Sequence[NDArray[np.generic]], shape: tuple[int, ...], kind: type[np.generic]
) -> NDArray[np.generic]:
    return np.concatenate([np.zeros(shape, kind), *arrays])
