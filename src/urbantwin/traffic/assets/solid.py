"""Solids: closed triangle meshes with a material per triangle, before they become an asset."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from urbantwin.geometry import LabelledMesh
from urbantwin.taxonomy import material_id

__all__ = ["Solid", "fitted", "labelled"]


@dataclass(frozen=True, eq=False)
class Solid:
    """A closed surface around a volume.

    Every edge belongs to exactly two triangles that run through it in opposite directions, and
    normals point out of the volume.

    Attributes:
        vertices: (V, 3) float64, metres, asset frame (x forward, y left, z up).
        faces: (F, 3) int32, counter-clockwise seen from outside.
        material: (F,) uint8, numbers of ``urbantwin.taxonomy.materials``.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]
    material: NDArray[np.uint8]

    @classmethod
    def build(cls, vertices: ArrayLike, faces: ArrayLike, material: str | list[str]) -> Solid:
        """Build from anything array-like; ``material`` is one name or one name per triangle."""
        triangles = np.asarray(faces, np.int32).reshape(-1, 3)
        if isinstance(material, str):
            numbers = np.full(len(triangles), material_id(material), np.uint8)
        else:
            known = {name: material_id(name) for name in set(material)}
            numbers = np.array([known[name] for name in material], np.uint8)
        return cls(np.asarray(vertices, np.float64).reshape(-1, 3), triangles, numbers)

    def moved(self, offset: ArrayLike) -> Solid:
        """Return the solid shifted by (3,) metres."""
        return Solid(self.vertices + np.asarray(offset, np.float64), self.faces, self.material)

    def scaled(self, factors: ArrayLike) -> Solid:
        """Return the solid stretched along x, y and z by positive factors about the origin."""
        return Solid(self.vertices * np.asarray(factors, np.float64), self.faces, self.material)

    def rotated(self, rotation: NDArray[np.float64]) -> Solid:
        """Return the solid turned about the origin by a (3, 3) rotation matrix."""
        return Solid(self.vertices @ rotation.T, self.faces, self.material)

    def mirrored(self) -> Solid:
        """Return the solid's reflection at the plane y = 0, normals still outward."""
        return Solid(self.vertices * [1.0, -1.0, 1.0], self.faces[:, ::-1].copy(), self.material)

    def volume(self) -> float:
        """Return the enclosed volume (divergence theorem), cubic metres; negative if inside out."""
        a, b, c = np.moveaxis(self.vertices[self.faces], 1, 0)
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def labelled(solids: Iterable[Solid], semantic: int) -> LabelledMesh:
    """Join solids into a mesh of one semantic class; ``part`` counts the solids from 1."""
    return LabelledMesh.concatenate(
        LabelledMesh.build(solid.vertices, solid.faces, semantic, solid.material, part)
        for part, solid in enumerate(solids, 1)
    )


def fitted(
    solids: Sequence[Solid], size: ArrayLike, *, like: Sequence[Solid] | None = None
) -> list[Solid]:
    """Stretch solids to exact bounds: x and y centred on the origin, z from 0 up.

    Args:
        solids: of one asset.
        size: (3,) length, width and height, metres.
        like: the solids whose bounds are meant (another phase of the asset); else ``solids``.
    """
    corners = np.concatenate([solid.vertices for solid in like or solids])
    low, high = corners.min(axis=0), corners.max(axis=0)
    middle = np.array([*(low + high)[:2] / 2, low[2]])
    factors = np.asarray(size) / (high - low)
    return [solid.moved(-middle).scaled(factors) for solid in solids]
