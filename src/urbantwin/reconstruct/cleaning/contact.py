"""Contacts between the pieces of a mesh."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter
from scipy.spatial import cKDTree

from urbantwin.io.model import TriangleMesh
from urbantwin.reconstruct.cleaning.height_grid import Grid
from urbantwin.reconstruct.cleaning.rays import Rays
from urbantwin.reconstruct.cleaning.weld import Pieces, bounds_of_faces

__all__ = ["Contacts"]

#: Maximum number of steps along a triangle's longest side.
_MOST_STEPS = 128
#: Number of nearest points examined: at a spacing of the reach, a sheet has five within reach.
_NEIGHBOURS = 16
#: Factor of the gap over which loose pieces support each other, for leaves of a crown.
_CLUSTER = 2.5
#: Length above which pieces are wide, metres.
_WIDE_M = 2.0
#: Number of triangles and quads within a radius (metres) from which they are leaves.
_LEAVES = 12
_LEAVES_WITHIN_M = 1.5
#: Points per batch.
_AT_ONCE = 200_000
#: Cell size of the height grid that excludes pieces far above everything, metres.
_CELL_M = 1.0
_AXES = np.array([[0, 0, -1], [0, 0, 1], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]], np.float32)

_NONE = np.zeros((0, 2), np.int64)


class Contacts:
    """Finds the contacts of loose pieces with fixed ones and with each other.

    Args:
        mesh: welded, site frame, metres.
        pieces: the K pieces of the mesh.
        loose: (K,) bool.
        wide: (K,) bool, pieces in ``rays``.
        rays: ray caster of the wide pieces.
    """

    def __init__(
        self,
        mesh: TriangleMesh,
        pieces: Pieces,
        loose: NDArray[np.bool_],
        wide: NDArray[np.bool_],
        rays: Rays,
    ) -> None:
        self._pieces, self._loose = pieces, loose
        of_loose = loose[pieces.of_face]
        self._corners = mesh.vertices[mesh.faces[of_loose]]
        self._owner = pieces.of_face[of_loose]
        fixed = ~of_loose
        self._scenes: list[tuple[Rays, NDArray[np.int64]]] = []
        if not (wide & loose).any():
            self._scenes.append((rays, np.flatnonzero(wide[pieces.of_face])))
            fixed &= ~wide[pieces.of_face]
        rest = np.flatnonzero(fixed)
        if len(rest):
            self._scenes.append((Rays(mesh.vertices, mesh.faces[rest]), rest))
        faces = mesh.faces[~of_loose]
        self._feet = mesh.vertices[pieces.foot]
        self._coarse = self._leaves()[self._owner]
        self._low = self._over_everything(mesh.vertices, faces)

    def _leaves(self) -> NDArray[np.bool_]:
        """Return the mask of pieces (K,) that are leaves, for which few sample points suffice."""
        pieces = self._pieces
        leaf = self._loose & (pieces.triangles <= 2) & (pieces.size.max(axis=1) < _WIDE_M)
        numbers = np.flatnonzero(leaf)
        if len(numbers) > _LEAVES:
            middle = pieces.middle[numbers]
            far, _ = cKDTree(middle).query(middle, k=[_LEAVES], workers=-1)
            leaf[numbers[far[:, 0] > _LEAVES_WITHIN_M]] = False
            return np.asarray(leaf)
        return np.zeros(len(pieces), bool)

    def _points_on(
        self, some: NDArray[np.bool_], spacing: float
    ) -> tuple[NDArray[np.float64], NDArray[np.integer]]:
        """Return points (N, 3) on some of the loose triangles, and their pieces (N,)."""
        parts = [
            _sampled(self._corners[part], self._owner[part], step)
            for part, step in (
                (some & ~self._coarse, spacing),
                (some & self._coarse, 2 * spacing),
            )
        ]
        return np.concatenate([p for p, _ in parts]), np.concatenate([o for _, o in parts])

    def _over_everything(
        self, vertices: NDArray[np.float64], faces: NDArray[np.int32]
    ) -> NDArray[np.bool_]:
        """Return the mask of pieces (K,) that may touch fixed ones: all except those far above."""
        pieces = self._pieces
        able = self._loose.copy()
        if not len(faces):
            return np.zeros(len(pieces), bool)
        low, high = bounds_of_faces(vertices, faces)
        bounds = (*low[:, :2].min(axis=0), *high[:, :2].max(axis=0))
        span = max(bounds[2] - bounds[0], bounds[3] - bounds[1])
        grid = Grid.over(bounds, max(_CELL_M, span / 1000))
        top = np.full(grid.shape, -np.inf)
        wide = np.maximum(*(high - low)[:, :2].T) > grid.step
        small, large = ~wide, np.flatnonzero(wide)
        for x, y in ((low, low), (low, high), (high, low), (high, high)):
            cell = grid.cells(np.column_stack([x[small, 0], y[small, 1]]))
            np.maximum.at(top, cell, high[small, 2])
        # A wide triangle marks the cells around sample points on it.
        places, whose = _sampled(vertices[faces[large]], np.arange(len(large)), grid.step, 1024)
        np.maximum.at(top, grid.cells(places), high[large[whose], 2])
        top = maximum_filter(top, 5)
        over = pieces.low[:, 2] - top[grid.cells(pieces.middle[:, :2])]
        over[pieces.size[:, :2].max(axis=1) > 2 * grid.step] = -np.inf
        return np.asarray(able & (over < 0.5))

    def _first(
        self, origins: NDArray[np.float64], axis: NDArray[np.float32]
    ) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
        """Return the first fixed piece (N,) along rays, and its distance."""
        piece = np.full(len(origins), -1, np.int64)
        nearest = np.full(len(origins), np.inf, np.float32)
        for rays, numbers in self._scenes:
            face, distance = rays.first(origins, axis)
            better = distance < nearest
            piece[better] = self._pieces.of_face[numbers[face[better]]]
            nearest[better] = distance[better]
        return piece, nearest

    def resting(self, reach: float) -> NDArray[np.int64]:
        """Return pairs (P, 2) of a loose piece and the piece within ``reach`` below its foot."""
        numbers = np.flatnonzero(self._low)
        if not len(numbers):
            return _NONE
        other, distance = self._first(self._feet[numbers] + [0, 0, 1e-3], _AXES[0])
        near = distance < reach
        return np.column_stack([numbers[near], other[near]]).astype(np.int64)

    def within(self, reach: float) -> NDArray[np.int64]:
        """Return pairs (P, 2) of pieces within about a distance of each other.

        Rays are cast along the axes from points on the loose pieces, with the distance as spacing.

        Args:
            reach: the distance, metres.
        """
        fixed, loose = self._fixed_within(reach), self._loose_within(_CLUSTER * reach)
        return np.concatenate([fixed, loose])

    def _fixed_within(self, reach: float) -> NDArray[np.int64]:
        some = self._low[self._owner]
        if not some.any():
            return _NONE
        points, owner = self._points_on(some, reach)
        pairs = [_NONE]
        for axis in _AXES:
            other, distance = self._first(points - 1e-3 * axis, axis)
            near = distance < reach
            pairs.append(_each_once(owner[near], other[near]))
        return np.concatenate(pairs)

    def _loose_within(self, reach: float) -> NDArray[np.int64]:
        numbers = np.flatnonzero(self._loose)
        if len(numbers) < 2:
            return _NONE
        low, high = self._pieces.low[numbers] - reach / 2, self._pieces.high[numbers] + reach / 2
        boxes = shapely.box(low[:, 0], low[:, 1], high[:, 0], high[:, 1])
        # Small pieces have few points; wide ones are used only near another piece.
        wide = np.flatnonzero(self._pieces.size[numbers].max(axis=1) > _WIDE_M)
        first, second = shapely.STRtree(boxes).query(boxes[wide], predicate="intersects")
        first = wide[first]
        meet = (first != second) & (low[first, 2] < high[second, 2])
        meet &= low[second, 2] < high[first, 2]
        beside = np.zeros(len(self._pieces), bool)
        beside[numbers] = True
        beside[numbers[wide]] = False
        beside[numbers[first[meet]]] = True
        some = beside[self._owner]
        if not some.any():
            return _NONE
        points, owner = self._points_on(some, reach)
        tree = cKDTree(points)
        count = min(_NEIGHBOURS, len(points))
        pairs = [_NONE]
        for part in np.array_split(np.arange(len(points)), max(1, len(points) // _AT_ONCE)):
            _, index = tree.query(
                points[part], k=count, distance_upper_bound=1.2 * reach, workers=-1
            )
            index = index.reshape(len(part), count)
            row, column = np.nonzero(index < len(points))
            one, other = owner[index[row, column]], owner[part][row]
            apart = one != other
            pairs.append(_each_once(one[apart], other[apart]))
        return _each_once(*np.concatenate(pairs).T)


def _each_once(one: NDArray[np.integer], other: NDArray[np.integer]) -> NDArray[np.int64]:
    """Return unique pairs (P, 2) of numbers below 2**31."""
    keys = np.unique((one.astype(np.int64) << 32) | other.astype(np.int64))
    return np.column_stack([keys >> 32, keys & 0xFFFFFFFF])


def _sampled(
    corners: NDArray[np.float64],
    owner: NDArray[np.integer],
    spacing: float,
    most: int = _MOST_STEPS,
) -> tuple[NDArray[np.float64], NDArray[np.integer]]:
    """Return points (N, 3) on triangles, about ``spacing`` apart, and their owners (N,)."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    sides = (a - b, b - c, c - a)
    points, owners = [np.zeros((0, 3))], [np.zeros(0, owner.dtype)]
    if len(corners):
        longest = np.sqrt(np.maximum.reduce([(side**2).sum(axis=1) for side in sides]))
        # in powers of two, to process triangles in few batches
        steps = np.clip(longest / spacing, 1, most)
        level = 2 ** np.ceil(np.log2(steps)).astype(np.int64)
        for n in np.unique(level):
            i, j = (k.ravel() for k in np.indices((n + 1, n + 1)))
            inside = i + j <= n
            u, v = (i[inside] / n)[None, :, None], (j[inside] / n)[None, :, None]
            members = np.flatnonzero(level == n)
            place = a[members][:, None] - u * sides[0][members][:, None]
            place += v * sides[2][members][:, None]
            points.append(place.reshape(-1, 3))
            owners.append(np.repeat(owner[members], u.size))
    return np.concatenate(points), np.concatenate(owners)
