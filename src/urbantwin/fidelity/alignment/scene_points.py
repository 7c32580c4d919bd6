"""Points of the scene, and their visibility from a position."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from urbantwin.fidelity.alignment.lane_markings import mark_lines
from urbantwin.fidelity.alignment.road_edges import road_edges
from urbantwin.geometry import DownwardProbe, LabelledMesh, SurfaceMaterials
from urbantwin.geometry.rays import RayScene
from urbantwin.taxonomy import GROUND_CLASSES, semantic_id

__all__ = ["ScenePoints"]

#: Distance between neighbouring points on the ground and on everything else, metres.
GROUND_SPACING_M, OTHER_SPACING_M = 0.4, 0.15
_MOST_POINTS = 2_000_000
#: Maximum width and minimum height of a post; height of its lower part, by which it is recognised,
#: and the minimum number of points there; tolerance of its points' distance from the axis beyond
#: half of its diagonal; metres.
_POST_WIDE_M, _POST_HIGH_M, _POST_LOW_M, _POST_POINTS, _POST_NEAR_M = 0.6, 1.8, 2.5, 8, 0.05
_GROUND = tuple(semantic_id(name) for name in GROUND_CLASSES)


class ScenePoints:
    """The surfaces of a static world as evenly distributed points.

    Args:
        mesh: the static world, site frame.
        middle: (2,) centre of the area.
        reach_m: radius of the area.
        surface: paint on its roads.

    Attributes:
        points: (N, 3) float64, site frame.
        normals: (N, 3) normals of the surfaces.
        is_ground: (N,) whether the surface is walkable.
        is_raised: (N,) whether the surface is above the ground; faces of curbs are neither.
        object: (N,) object with a common error of position: a building, a pole.
        is_post: (N,) whether the point is on a pole or trunk that is thin and high enough to be
            recognised in a frame.
        posts: (K, 3) feet of their axes.
        edges: (E, 3) points along the edges of carriageways.
        edge_normal: (E, 3) level unit vectors from there towards the road.
        lines: (L, 3) points along painted lines.
        line_normal: (L, 3) level unit vectors across them.
    """

    def __init__(
        self,
        mesh: LabelledMesh,
        middle: NDArray[np.float64],
        reach_m: float,
        surface: SurfaceMaterials | None = None,
    ) -> None:
        corners = mesh.triangles()
        least, most = corners[..., :2].min(axis=1), corners[..., :2].max(axis=1)
        near = ((least < middle + reach_m) & (most > middle - reach_m)).all(axis=1)
        self._near = mesh.select(near)
        self._origin = np.array([*middle, 0.0])
        self._caster = RayScene(self._near.vertices - self._origin, self._near.faces)
        face = _strewn(self._near)
        generator = np.random.default_rng(len(face))
        u, v = generator.random((2, len(face)))
        over = u + v > 1
        u, v = np.where(over, 1 - u, u), np.where(over, 1 - v, v)
        a, b, c = np.moveaxis(self._near.triangles()[face], 1, 0)
        points = a + u[:, None] * (b - a) + v[:, None] * (c - a)
        inside = np.hypot(*(points[:, :2] - middle).T) < reach_m
        self.points = points[inside]
        normals = self._near.normals()
        self.normals = normals[face[inside]]
        low = np.isin(self._near.semantic, _GROUND)
        ground = low & (normals[:, 2] > 0.1)
        self.is_ground = ground[face[inside]]
        self.is_raised = ~low[face[inside]]
        key = self._near.part + self._near.semantic.astype(np.int64) * (1 << 32)
        self.object = np.where(self._near.part > 0, key, 0)[face[inside]]
        self.is_post, self.posts = _posts(self.points, np.where(self.is_raised, self.object, 0))
        flat = self._near.select(ground)
        self._probe = DownwardProbe(flat) if len(flat.faces) else None
        self._top = float(points[:, 2].max()) + 1.0 if len(points) else 0.0
        self.edges, self.edge_normal = road_edges(flat)
        lines, across = mark_lines(surface or SurfaceMaterials(), middle, reach_m)
        height = self.ground_at(lines)
        known = np.isfinite(height)
        self.lines = np.column_stack([lines, height])[known]
        self.line_normal = np.column_stack([across, np.zeros(len(lines))])[known]

    def seen_from(self, place: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return the mask of the points (N,) visible from a position (3,)."""
        away = self.points - place
        distance = np.linalg.norm(away, axis=1)
        aim = (away / np.maximum(distance, 1e-9)[:, None]).astype(np.float32)
        met = self._caster.cast(place - self._origin, aim).range_m
        return np.asarray(met > distance - 0.05 - 0.002 * distance)

    def ground_at(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the ground height (N,) at (N, 2) positions; nan if there is no ground."""
        if self._probe is None:
            return np.full(len(xy), np.nan)
        return self._probe.height_below(np.column_stack([xy, np.full(len(xy), self._top)]))


def _posts(
    points: NDArray[np.float64], of: NDArray[np.int64]
) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Return the mask of the points (N,) on posts, and the feet (K, 3) of the posts.

    Args:
        points: (N, 3).
        of: (N,) object of each point; 0: none.
    """
    _, number = np.unique(of, return_inverse=True)
    count = int(number.max(initial=-1)) + 1
    least, most = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(least, number, points)
    np.maximum.at(most, number, points)
    low = points[:, 2] < least[number, 2] + _POST_LOW_M
    first, last = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    np.minimum.at(first, number[low], points[low, :2])
    np.maximum.at(last, number[low], points[low, :2])
    wide = (last - first).max(axis=1)
    thin = (wide < _POST_WIDE_M) & (most[:, 2] - least[:, 2] > _POST_HIGH_M)
    thin &= np.bincount(number[low], minlength=count) >= _POST_POINTS
    thin[number[of == 0]] = False
    axis = (first + last) / 2
    away = np.hypot(*(points[:, :2] - axis[number]).T)
    feet = np.column_stack([axis, least[:, 2]])[thin]
    return thin[number] & (away < wide[number] / np.sqrt(2.0) + _POST_NEAR_M), feet


def _strewn(mesh: LabelledMesh) -> NDArray[np.int64]:
    """Return the triangle of each point, in proportion to area."""
    ground = np.isin(mesh.semantic, _GROUND)
    spacing = np.where(ground, GROUND_SPACING_M, OTHER_SPACING_M)
    wanted = mesh.areas() / spacing**2
    wanted *= min(1.0, _MOST_POINTS / max(wanted.sum(), 1.0))
    # Systematic sampling by the running sum: small triangles are not left out, and the number of
    # points follows from the area.
    passed = np.floor(np.cumsum(wanted)).astype(np.int64)
    count = np.diff(np.concatenate([[0], passed]))
    return np.repeat(np.arange(len(count)), count)
