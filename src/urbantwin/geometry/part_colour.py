"""Colours of parts of a mesh, for pictures: of a building's walls and of its roof."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact.arrays import ArrayOf, read_arrays
from urbantwin.geometry.mesh import LabelledMesh

__all__ = ["PartColours"]

#: Triangles that rise by more than this (z of the unit normal) face up.
UPRIGHT = 0.05
_FORM = {
    "part": ArrayOf("i4", ("N",), least=0, most=(1 << 31) - 1),
    "material": ArrayOf("u1", ("N",)),
    "up": ArrayOf("u1", ("N",), least=0, most=1),
    "rgb": ArrayOf("u1", ("N", 3)),
}


def _none(*shape: int) -> NDArray[np.uint8]:
    return np.zeros(shape, np.uint8)


@dataclass(frozen=True, eq=False)
class PartColours:
    """Colours of the triangles with one material in one part of a mesh.

    Attributes:
        part: (N,) int32, numbers of parts, as in ``LabelledMesh.part``.
        material: (N,) uint8, numbers of materials.
        up: (N,) uint8, 1 for triangles facing up (a roof), 0 for walls and those facing down.
        rgb: (N, 3) uint8, sRGB.
    """

    part: NDArray[np.int32] = field(default_factory=lambda: np.zeros(0, np.int32))
    material: NDArray[np.uint8] = field(default_factory=lambda: _none(0))
    up: NDArray[np.uint8] = field(default_factory=lambda: _none(0))
    rgb: NDArray[np.uint8] = field(default_factory=lambda: _none(0, 3))

    @classmethod
    def of_rows(cls, rows: Iterable[tuple[int, int, bool, tuple[int, ...]]]) -> PartColours:
        """Return the colours of (part, material, faces up, sRGB); the first of a key counts."""
        first: dict[tuple[int, int, bool], tuple[int, ...]] = {}
        for part, material, up, rgb in rows:
            first.setdefault((part, material, up), rgb)
        keys = np.array(sorted(first), np.int32).reshape(-1, 3)
        colours = np.array([first[key] for key in sorted(first)], np.uint8).reshape(-1, 3)
        return cls(keys[:, 0], keys[:, 1].astype(np.uint8), keys[:, 2].astype(np.uint8), colours)

    def moved(self, by: int) -> PartColours:
        """Return the colours of the same parts, numbered from ``by``."""
        return PartColours(self.part + np.int32(by), self.material, self.up, self.rgb)

    def of_faces(
        self, mesh: LabelledMesh, faces: NDArray[np.int64]
    ) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
        """Return colours (N, 3) of some triangles (N,), and which of them have one.

        If only the other direction has a colour, it is used too: window sills have the colour of
        walls.
        """
        rgb, known = np.zeros((len(faces), 3), np.uint8), np.zeros(len(faces), bool)
        if not len(self.part):
            return rgb, known
        up = (mesh.normals(faces)[:, 2] > UPRIGHT).astype(np.int64)
        key = mesh.part[faces].astype(np.int64) * 512 + mesh.material[faces].astype(np.int64) * 2
        own = self.part.astype(np.int64) * 512 + self.material.astype(np.int64) * 2 + self.up
        order = np.argsort(own)
        for wanted in (key + 1 - up, key + up):
            at = order[np.minimum(np.searchsorted(own, wanted, sorter=order), len(own) - 1)]
            found = own[at] == wanted
            rgb[found], known = self.rgb[at[found]], known | found
        return rgb, known

    def save(self, path: Path) -> None:
        """Write a ``.npz``; the same colours give the same bytes."""
        np.savez_compressed(path, part=self.part, material=self.material, up=self.up, rgb=self.rgb)

    @classmethod
    def load(cls, path: Path) -> PartColours:
        """Read a file written by ``save``.

        Raises:
            InputError: the file is missing, damaged or has no colours.
        """
        data = read_arrays(path, "a twin's colours of buildings", _FORM)
        return cls(data["part"], data["material"], data["up"], data["rgb"])
