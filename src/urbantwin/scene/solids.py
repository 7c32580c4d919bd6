"""Primitive solids, and their assembly into one labelled mesh."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from urbantwin.geometry import LabelledMesh
from urbantwin.taxonomy import material_id, semantic_id

__all__ = ["Assembly", "GroundHeight", "Solid", "box", "columns", "rods", "sweep"]

#: Triangles of less than this area, doubled, are dropped.
SLIVER_M2 = 1e-7

#: Heights (N,) of the ground, metres, at (N, 2) points of the site frame; nan where unknown.
GroundHeight = Callable[[NDArray[np.float64]], NDArray[np.float64]]


@dataclass(frozen=True, eq=False)
class Solid:
    """Triangles without labels: ``vertices`` (V, 3) metres, ``faces`` (F, 3) seen from outside."""

    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]

    def rises(self) -> NDArray[np.float64]:
        """Return the z (F,) of the unit normals: 1 for a flat roof, 0 for a wall."""
        a, b, c = np.moveaxis(self.vertices[self.faces], 1, 0)
        normal = np.cross(b - a, c - a)
        length = np.linalg.norm(normal, axis=1)
        return np.asarray(np.divide(normal[:, 2], length, out=np.zeros(len(a)), where=length > 0))

    def volume(self) -> float:
        """Return the enclosed volume, positive where the normals point outward."""
        a, b, c = np.moveaxis(self.vertices[self.faces] - self.vertices[:1], 1, 0)
        return float((a * np.cross(b, c)).sum() / 6)


class Assembly:
    """Collects solids with their labels; ``mesh`` joins them."""

    def __init__(self) -> None:
        self._solids: list[Solid] = []
        self._labels: list[tuple[ArrayLike, ArrayLike, ArrayLike]] = []
        self.parts = 0

    def new_part(self) -> int:
        """Return the number of a new object: 1, 2, 3, ..."""
        self.parts += 1
        return self.parts

    def add(
        self, solid: Solid, semantic: str | ArrayLike, material: str | ArrayLike, part: ArrayLike
    ) -> None:
        """Add a solid; classes, materials and parts may be given per face as numbers."""
        kind = semantic_id(semantic) if isinstance(semantic, str) else semantic
        number = material_id(material) if isinstance(material, str) else material
        self._solids.append(solid)
        self._labels.append((kind, number, part))

    def mesh(self) -> LabelledMesh:
        """Return all added solids as one mesh."""
        if not self._solids:
            return LabelledMesh.empty()
        starts = np.cumsum([0] + [len(solid.vertices) for solid in self._solids[:-1]])
        counts = [len(solid.faces) for solid in self._solids]

        def spread(values: list[ArrayLike]) -> NDArray[np.int64]:
            columns = [
                np.broadcast_to(np.asarray(value, np.int64), (count,))
                for value, count in zip(values, counts, strict=True)
            ]
            return np.concatenate(columns)

        return LabelledMesh.build(
            np.concatenate([solid.vertices for solid in self._solids]),
            np.concatenate(
                [solid.faces + start for solid, start in zip(self._solids, starts, strict=True)]
            ),
            spread([label[0] for label in self._labels]),
            spread([label[1] for label in self._labels]),
            spread([label[2] for label in self._labels]),
        )


_BOX_CORNERS = np.array([[x, y, z] for z in (-0.5, 0.5) for y in (-0.5, 0.5) for x in (-0.5, 0.5)])
_BOX_FACES = np.array(
    [
        *([0, 2, 3], [0, 3, 1], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4]),
        *([1, 3, 7], [1, 7, 5], [3, 2, 6], [3, 6, 7], [2, 0, 4], [2, 4, 6]),
    ]
)


def box(centre: ArrayLike, size: ArrayLike, yaw: ArrayLike = 0.0) -> Solid:
    """Return boxes: centres (3,) or (N, 3), sizes along/across/up (3,) or (N, 3), yaws in rad."""
    centres = np.asarray(centre, np.float64).reshape(-1, 3)
    sizes = np.asarray(size, np.float64).reshape(-1, 3)
    yaws = np.broadcast_to(np.asarray(yaw, np.float64), (len(centres),))
    local = _BOX_CORNERS[None] * sizes[:, None]
    c, s = np.cos(yaws)[:, None], np.sin(yaws)[:, None]
    turned = np.stack(
        [local[..., 0] * c - local[..., 1] * s, local[..., 0] * s + local[..., 1] * c],
        axis=-1,
    )
    upright = np.broadcast_to(local[..., 2:], (len(centres), 8, 1))
    vertices = np.concatenate([turned, upright], axis=-1) + centres[:, None]
    return Solid(vertices.reshape(-1, 3), _repeated(_BOX_FACES, 8, len(centres)))


def columns(
    feet: ArrayLike, heights: ArrayLike, radii: ArrayLike, top_radii: ArrayLike, sides: int = 8
) -> Solid:
    """Return upright tapered cylinders: feet (N, 3), heights, radii below and above (N,) m."""
    low = np.asarray(feet, np.float64).reshape(-1, 3)
    high = low.copy()
    high[:, 2] += np.asarray(heights, np.float64)
    return rods(low, high, radii, top_radii, sides)


def rods(
    starts: ArrayLike, ends: ArrayLike, radii: ArrayLike, end_radii: ArrayLike, sides: int = 8
) -> Solid:
    """Return closed tapered cylinders between points (N, 3) and (N, 3), radii (N,) metres.

    Their cross-section is a polygon of ``sides`` corners on the circle.
    """
    start = np.asarray(starts, np.float64).reshape(-1, 3)
    end = np.asarray(ends, np.float64).reshape(-1, 3)
    count = len(start)
    axis = end - start
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    helper = np.where(np.abs(axis[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    u = np.cross(helper, axis)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(axis, u)
    turn = np.arange(sides) * 2 * np.pi / sides
    ring = u[:, None] * np.cos(turn)[:, None] + v[:, None] * np.sin(turn)[:, None]
    r0 = np.broadcast_to(np.asarray(radii, np.float64), (count,))[:, None, None]
    r1 = np.broadcast_to(np.asarray(end_radii, np.float64), (count,))[:, None, None]
    vertices = np.concatenate([start[:, None] + ring * r0, end[:, None] + ring * r1], axis=1)
    here = np.arange(sides)
    there = np.roll(here, -1)
    fan = np.column_stack([np.zeros(sides - 2, int), here[1:-1], here[2:]])
    faces = np.concatenate(
        [
            np.column_stack([here, there, there + sides]),
            np.column_stack([here, there + sides, here + sides]),
            fan[:, ::-1],
            fan + sides,
        ]
    )
    return Solid(vertices.reshape(-1, 3), _repeated(faces, 2 * sides, count))


def sweep(path: ArrayLike, profile: ArrayLike, *, closed: bool = False) -> Solid:
    """Return a profile carried along a path: fences' rails, walls, hedges.

    Args:
        path: (N, 3) points, metres, N >= 2; for a closed path the first is not repeated.
        profile: (P, 2) or (N, P, 2) of (metres to the left of the path, metres above it), a
            convex outline, counter-clockwise when looking along the path.
        closed: whether the last point is joined to the first.
    """
    points = np.asarray(path, np.float64).reshape(-1, 3)
    count = len(points)
    outline = np.asarray(profile, np.float64)
    outline = np.broadcast_to(outline, (count, *outline.shape[-2:]))
    left = _mitres(points[:, :2], closed)
    vertices = np.empty((count, outline.shape[1], 3))
    vertices[..., :2] = points[:, None, :2] + left[:, None] * outline[..., :1]
    vertices[..., 2] = points[:, None, 2] + outline[..., 1]

    sides = outline.shape[1]
    corner = np.arange(sides)
    step = np.arange(count if closed else count - 1)
    here = (step[:, None] * sides + corner).ravel()
    beside = (step[:, None] * sides + np.roll(corner, -1)).ravel()
    ahead = ((step[:, None] + 1) % count * sides + corner).ravel()
    ahead_beside = ((step[:, None] + 1) % count * sides + np.roll(corner, -1)).ravel()
    faces = [
        np.column_stack([here, ahead, ahead_beside]),
        np.column_stack([here, ahead_beside, beside]),
    ]
    if not closed:
        fan = np.column_stack([np.zeros(sides - 2, int), corner[1:-1], corner[2:]])
        faces += [fan, fan[:, ::-1] + (count - 1) * sides]
    solid = Solid(vertices.reshape(-1, 3), np.concatenate(faces).astype(np.int32))
    if count == 2 or _smallest_m2(solid) > SLIVER_M2:
        return solid
    # On the inside of a turn corners would overlap: every piece becomes a separate solid.
    ends = np.arange(count if closed else count - 1)
    return _joined([sweep(points[[k, (k + 1) % count]], outline[[k, (k + 1) % count]])
                    for k in ends.tolist()])  # fmt: skip


def _smallest_m2(solid: Solid) -> float:
    """Return twice the area of the smallest triangle."""
    a, b, c = np.moveaxis(solid.vertices[solid.faces], 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).min())


def _joined(solids: Sequence[Solid]) -> Solid:
    starts = np.cumsum([0] + [len(solid.vertices) for solid in solids[:-1]])
    faces = [solid.faces + start for solid, start in zip(solids, starts, strict=True)]
    vertices = np.concatenate([solid.vertices for solid in solids])
    return Solid(vertices, np.concatenate(faces).astype(np.int32))


def _mitres(xy: NDArray[np.float64], closed: bool) -> NDArray[np.float64]:
    """Return the vectors (N, 2) to the left of a path that keep its offset at corners."""
    ahead = np.roll(xy, -1, axis=0) - xy
    if not closed:
        ahead[-1] = ahead[-2]
    ahead /= np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-9)
    behind = np.roll(ahead, 1, axis=0)
    if not closed:
        behind[0] = ahead[0]
    left = np.column_stack([-ahead[:, 1], ahead[:, 0]]) + np.column_stack(
        [-behind[:, 1], behind[:, 0]]
    )
    # |left| = 2 cos(half the turn): dividing twice by it keeps the width; sharp turns are capped.
    return np.asarray(2 * left / np.maximum((left**2).sum(axis=1, keepdims=True), 0.5))


def _repeated(faces: NDArray[np.int64], vertices: int, count: int) -> NDArray[np.int32]:
    shift = np.arange(count)[:, None, None] * vertices
    return (faces[None] + shift).reshape(-1, 3).astype(np.int32)
