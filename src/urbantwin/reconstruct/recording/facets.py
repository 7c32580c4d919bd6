"""Objects above the ground as triangles between neighbouring beams, and patches of single beams."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay

from urbantwin.reconstruct.recording.beams import Beams
from urbantwin.reconstruct.recording.recorded_ground import RecordedGround

__all__ = ["POROUS", "SINGLE", "SURFACE", "Facets", "facets_of"]

#: Kinds of triangles.
SURFACE, POROUS, SINGLE = range(3)

#: Height up to which points are ground, metres.
ON_GROUND_M = 0.12
#: A surface continues between beams within this number of columns and rings, if their ranges differ
#: by less than a constant plus a multiple of their lateral distance, up to a maximum, and the
#: lateral distance is below the last value, metres.
_MOST_COLUMNS, _MOST_RINGS = 2.3, 1.3
_STEP_M, _SLANT, _MOST_STEP_M, _MOST_APART_M = 0.08, 3.0, 0.5, 0.8
#: Share of returns below which a surface is porous.
_SOLID = 0.7
#: Largest patch for one beam, metres.
_PATCH_M = 0.3


@dataclass(frozen=True, eq=False)
class Facets:
    """Triangles above the ground.

    Attributes:
        corners: (F, 3, 3) metres.
        kind: (F,) int32: `SURFACE` between beams of one surface; `POROUS`: a patch that rays pass
            through; `SINGLE`: a patch of one beam, connected to no surface.
        piece: (F,) int64, measurement of a triangle: the two of a patch share one.
    """

    corners: NDArray[np.float64]
    kind: NDArray[np.int32]
    piece: NDArray[np.int64]

    def select(self, keep: NDArray[np.bool_]) -> Facets:
        """Return the triangles with a true ``keep`` (F,)."""
        return Facets(self.corners[keep], self.kind[keep], self.piece[keep])

    @classmethod
    def concatenate(cls, parts: Sequence[Facets]) -> Facets:
        """Return all triangles, with consecutive numbers of pieces."""
        first = np.cumsum([0] + [int(one.piece.max(initial=-1)) + 1 for one in parts[:-1]])
        return cls(
            np.concatenate([one.corners for one in parts]),
            np.concatenate([one.kind for one in parts]),
            np.concatenate([one.piece + k for one, k in zip(parts, first, strict=True)]),
        )


def facets_of(beams: Beams, ground: RecordedGround) -> Facets:
    """Return the objects above the ground as one sensor saw them.

    Neighbouring beams with consistent ranges are corners of triangles. A beam without such a
    neighbour, or on a porous object, becomes a square patch across the beam, as large as the beam's
    share of the view, and smaller in proportion to the share of returns.
    """
    nodes = np.flatnonzero(beams.range_m[:, 0] > 0)
    points = beams.points()
    high = ground.above(points) > ON_GROUND_M
    solid = beams.share[:, 0] >= _SOLID
    corner = nodes[_neighbours(beams, nodes)]
    kept = solid[corner].all(axis=1) & high[corner].any(axis=1)
    corner = corner[kept]
    corner = corner[_goes_on(beams, points, corner)]
    surface = points[corner]
    alone = np.ones(len(points), bool)
    alone[corner.ravel()] = False
    patches, kinds = [], []
    for mode in range(beams.range_m.shape[1]):
        there = beams.range_m[:, mode] > 0
        place = points if mode == 0 else beams.points(mode)
        single = there & (ground.above(place) > ON_GROUND_M)
        if mode == 0:
            single &= alone
        chosen = np.flatnonzero(single)
        patches.append(_patches(beams, chosen, mode))
        kinds.append(np.where(solid[chosen] & (mode == 0), SINGLE, POROUS))
    squares = np.concatenate(patches)
    return Facets(
        np.concatenate([surface, squares.reshape(-1, 3, 3)]),
        np.concatenate(
            [np.full(len(surface), SURFACE), np.repeat(np.concatenate(kinds), 2)]
        ).astype(np.int32),
        np.concatenate(
            [np.arange(len(surface)), len(surface) + np.repeat(np.arange(len(squares)), 2)]
        ),
    )


def _neighbours(beams: Beams, nodes: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return triangles (F, 3) between neighbouring beams, as indices of nodes."""
    column = beams.azimuth[nodes] / beams.column_rad
    turn = 2 * np.pi / beams.column_rad
    ring = beams.ring[nodes].astype(np.float64)
    seam = np.flatnonzero(column < column.min() + 2 * _MOST_COLUMNS)
    plan = np.column_stack(
        [np.concatenate([column, column[seam] + turn]), np.concatenate([ring, ring[seam]])]
    )
    origin = np.concatenate([np.arange(len(nodes)), seam])
    triangle = Delaunay(plan).simplices
    apart = plan[triangle] - plan[np.roll(triangle, 1, axis=1)]
    near = (np.abs(apart) <= [_MOST_COLUMNS, _MOST_RINGS]).all(axis=(1, 2))
    return np.asarray(origin[triangle[near]])


def _goes_on(
    beams: Beams, points: NDArray[np.float64], corner: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Return the mask of triangles (F,) of one surface."""
    range_m = beams.range_m[corner, 0]
    step = np.abs(range_m - np.roll(range_m, 1, axis=1))
    away = np.linalg.norm(points[corner] - points[np.roll(corner, 1, axis=1)], axis=2)
    across = np.sqrt(np.maximum(away**2 - step**2, 0))
    fits = (step < np.minimum(_STEP_M + _SLANT * across, _MOST_STEP_M)) & (across < _MOST_APART_M)
    return np.asarray(fits.all(axis=1))


def _patches(beams: Beams, nodes: NDArray[np.int64], mode: int) -> NDArray[np.float64]:
    """Return squares (N, 2, 3, 3), each of two triangles across a beam."""
    range_m, share = beams.range_m[nodes, mode], beams.share[nodes, mode]
    way = beams.direction[nodes]
    aside = np.cross([0.0, 0.0, 1.0], way)
    aside /= np.maximum(np.linalg.norm(aside, axis=1, keepdims=True), 1e-9)
    up = np.cross(way, aside)
    scale = np.sqrt(np.clip(share, 0.05, 1.0)) / 2
    wide = np.minimum(range_m * beams.column_rad, _PATCH_M) * scale
    tall = np.minimum(range_m * beams.ring_rad[nodes], _PATCH_M) * scale
    middle = beams.place + way * range_m[:, None]
    a, b = aside * wide[:, None], up * tall[:, None]
    corners = np.stack([middle - a - b, middle + a - b, middle + a + b, middle - a + b], axis=1)
    return np.asarray(corners[:, [[0, 1, 2], [0, 2, 3]]])
