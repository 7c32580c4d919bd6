"""The ground visible from above: the first hit of rays straight down."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from urbantwin.geometry import DownwardProbe, LabelledMesh
from urbantwin.taxonomy import GROUND_CLASSES, semantic_id

__all__ = ["CARRIAGEWAY", "FOOTWAY", "OPEN", "VisibleGround", "ground_heights", "visible_ground"]

#: Zones: carriageways, footways and all other ground; 0 where the ground is hidden or missing.
CARRIAGEWAY, FOOTWAY, OPEN = 1, 2, 3
_ZONE_OF = {
    "road": CARRIAGEWAY,
    "parking": CARRIAGEWAY,
    "sidewalk": FOOTWAY,
    "other-ground": OPEN,
    "terrain": OPEN,
}
#: Imagery is not vertical: within this distance of objects it shows their sides, metres.
LEAN_M = 0.5
#: Rays cast at once.
BATCH = 1_000_000


@dataclass(frozen=True, eq=False)
class VisibleGround:
    """The ground under the cells of a grid, (ny, nx) each; row 0 is the southernmost.

    Attributes:
        zone: ``CARRIAGEWAY``, ``FOOTWAY``, ``OPEN`` or 0.
        material: number of the triangle's material.
        z: its height, metres; nan without a hit.
    """

    zone: NDArray[np.uint8]
    material: NDArray[np.uint8]
    z: NDArray[np.float32]


def visible_ground(
    mesh: LabelledMesh, x0: float, y0: float, cell_m: float, shape: tuple[int, int]
) -> VisibleGround:
    """Cast rays down on the centres of a grid's cells.

    Args:
        mesh: the static scene.
        x0: west edge of the grid, metres.
        y0: its south edge.
        cell_m: side of a cell.
        shape: rows and columns.
    """
    ny, nx = shape
    x = x0 + (np.arange(nx) + 0.5) * cell_m
    top = float(mesh.vertices[:, 2].max(initial=0.0)) + 1.0
    probe = DownwardProbe(mesh)
    zone_of = np.zeros(1 << 16, np.uint8)
    for name in GROUND_CLASSES:
        zone_of[semantic_id(name)] = _ZONE_OF[name]
    zone, material = np.zeros(shape, np.uint8), np.zeros(shape, np.uint8)
    hidden, z = np.zeros(shape, bool), np.full(shape, np.nan, np.float32)
    rows = max(1, BATCH // nx)
    for first in range(0, ny, rows):
        part = slice(first, min(first + rows, ny))
        y = y0 + (np.arange(part.start, part.stop) + 0.5) * cell_m
        east, north = np.meshgrid(x, y)
        points = np.column_stack([east.ravel(), north.ravel(), np.full(east.size, top)])
        face = probe.face_below(points)
        hit = face >= 0
        here = np.zeros(len(face), np.uint8)
        here[hit] = zone_of[mesh.semantic[face[hit]]]
        zone[part] = here.reshape(east.shape)
        hidden[part] = (hit & (here == 0)).reshape(east.shape)
        found = np.zeros(len(face), np.uint8)
        found[hit] = mesh.material[face[hit]]
        material[part] = found.reshape(east.shape)
        z[part] = _heights_on(mesh, face, points).reshape(east.shape)
    reach = max(1, round(LEAN_M / cell_m))
    zone[binary_dilation(hidden, np.ones((3, 3), bool), iterations=reach)] = 0
    return VisibleGround(zone, material, z)


def _heights_on(
    mesh: LabelledMesh, face: NDArray[np.int64], points: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the height (N,) of faces under points; nan where the face is -1."""
    z = np.full(len(face), np.nan)
    hit = np.flatnonzero(face >= 0)
    number, which = np.unique(face[hit], return_inverse=True)
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces[number]], 1, 0)
    normal = np.cross(b - a, c - a)
    up = np.where(np.abs(normal[:, 2]) > 1e-12, normal[:, 2], 1.0)
    slope = normal[:, :2] / up[:, None]
    way = points[hit, :2] - a[which, :2]
    z[hit] = a[which, 2] - slope[which, 0] * way[:, 0] - slope[which, 1] * way[:, 1]
    return z


def ground_heights(mesh: LabelledMesh, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the height (N,) of the lowest ground at points (N, 2), below all bridges.

    nan if there is no ground.
    """
    below = mesh.select(mesh.is_ground & (mesh.normals()[:, 2] > 0.1))
    if not len(below.faces):
        return np.full(len(points), np.nan)
    mirrored = LabelledMesh.build(
        below.vertices * [1.0, 1.0, -1.0], below.faces, below.semantic, below.material
    )
    top = float(mirrored.vertices[:, 2].max()) + 1.0
    probe = DownwardProbe(mirrored)
    return -probe.height_below(np.column_stack([points, np.full(len(points), top)]))
