"""Walls of a building with recessed openings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Geometry, Polygon

from urbantwin.scene.building_outline import MappedBuilding
from urbantwin.scene.building_volume import Volume

__all__ = [
    "DOOR",
    "FLOOR",
    "GLASS",
    "ROOF",
    "WALL",
    "Front",
    "Opening",
    "Wall",
    "WallMesh",
    "wall_mesh",
]

#: Undersides, walls, roofs, window panes, doors.
FLOOR, WALL, ROOF, GLASS, DOOR = range(5)


@dataclass(frozen=True, eq=False)
class Wall:
    """A vertical piece of a surface over an edge in plan, with the solid on its left.

    Attributes:
        start, end: numbers of the corners in plan.
        start_xy, end_xy: positions of the corners, metres.
        left, right: heights of the vertices over the start and over the end, in ascending order.
        body: number of its body.
        outer: whether no other part of the building is in front of it.
    """

    start: int
    end: int
    start_xy: tuple[float, float]
    end_xy: tuple[float, float]
    left: list[float]
    right: list[float]
    body: int
    outer: bool

    @property
    def length(self) -> float:
        """Its length in plan, metres."""
        return float(np.hypot(self.end_xy[0] - self.start_xy[0], self.end_xy[1] - self.start_xy[1]))


@dataclass(frozen=True)
class Opening:
    """A window or door: a recessed rectangle of a wall.

    Attributes:
        start, end: metres along the wall from its start.
        low, high: heights, metres.
        depth: depth of the reveal, metres.
        kind: kind of the pane's faces, as in ``scene.face``.
    """

    start: float
    end: float
    low: float
    high: float
    depth: float
    kind: int


@dataclass(frozen=True, eq=False)
class WallMesh:
    """Triangles of a wall; indices below 0 are the given vertices -1 - index of its ring."""

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    kind: NDArray[np.uint8]
    body: int


#: Corners of an opening, counter-clockwise seen from outside: share of (start..end), (low..high).
_CORNERS = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])


def wall_mesh(wall: Wall, ring: Sequence[int], openings: Sequence[Opening]) -> WallMesh | None:
    """Return a wall's triangles: around its openings, their reveals, and the panes.

    Args:
        wall: the wall.
        ring: numbers of the vertices over its start, from the top, then over its end, from below.
        openings: rectangles within the wall.

    Returns:
        The triangles; ``None`` if openings touch each other or the wall's border.
    """
    p, q = np.array(wall.start_xy), np.array(wall.end_xy)
    length = wall.length
    ahead = (q - p) / length
    inward = np.array([-ahead[1], ahead[0]])
    outline = [(0.0, z) for z in wall.left[::-1]] + [(length, z) for z in wall.right]

    rectangle = np.array([[o.start, o.low, o.end, o.high] for o in openings])
    corner = np.stack(
        [
            rectangle[:, [0]] + (rectangle[:, [2]] - rectangle[:, [0]]) * _CORNERS[:, 0],
            rectangle[:, [1]] + (rectangle[:, [3]] - rectangle[:, [1]]) * _CORNERS[:, 1],
        ],
        axis=-1,
    )  # (O, 4, 2)
    holes = np.concatenate([corner, corner[:, :1]], axis=1)
    area = Polygon(outline, holes)
    if not area.is_valid:
        return None
    front = _around(outline, ring, corner, area)

    count = len(openings)
    base = 8 * np.arange(count)[:, None]
    here = base + np.arange(4)
    there = base + np.roll(np.arange(4), -1)
    reveals = np.concatenate(
        [
            np.stack([here, there, there + 4], axis=-1).reshape(-1, 3),
            np.stack([here, there + 4, here + 4], axis=-1).reshape(-1, 3),
        ]
    )
    panes = np.stack([base + [4, 5, 6], base + [4, 6, 7]], axis=1).reshape(-1, 3)

    depth = np.array([o.depth for o in openings])
    xy = p + corner[..., :1] * ahead  # (O, 4, 2)
    back = xy + depth[:, None, None] * inward
    z = corner[..., 1:]
    vertices = np.stack(
        [np.concatenate([xy, z], axis=-1), np.concatenate([back, z], axis=-1)], axis=1
    ).reshape(-1, 3)
    kind = np.concatenate(
        [
            np.full(len(front) + len(reveals), WALL, np.uint8),
            np.repeat(np.array([o.kind for o in openings], np.uint8), 2),
        ]
    )
    return WallMesh(vertices, np.concatenate([front, reveals, panes]), kind, wall.body)


def _around(
    outline: list[tuple[float, float]],
    ring: Sequence[int],
    corner: NDArray[np.float64],
    area: Polygon,
) -> NDArray[np.int64]:
    """Triangulate a wall around its openings, (F, 3): its ring as -1 - number."""
    index = {place: -1 - number for place, number in zip(outline, ring, strict=True)}
    places = corner.reshape(-1, 2).tolist()
    number = (8 * np.arange(len(corner))[:, None] + np.arange(4)).ravel().tolist()
    index.update(((s, z), k) for (s, z), k in zip(places, number, strict=True))
    pieces = shapely.get_parts(shapely.constrained_delaunay_triangles(area))
    points = shapely.get_coordinates(pieces).reshape(-1, 4, 2)[:, :3]
    turn = points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]
    clockwise = turn[0][:, 0] * turn[1][:, 1] < turn[0][:, 1] * turn[1][:, 0]
    points[clockwise] = points[clockwise][:, ::-1]
    numbers = [index[s, z] for s, z in points.reshape(-1, 2).tolist()]
    return np.array(numbers, np.int64).reshape(-1, 3)


@dataclass(frozen=True, eq=False)
class Front:
    """A building's walls, with the mapped properties of their bodies.

    Attributes:
        building: the building.
        volumes: volume of each body, in the order of ``Wall.body``.
        walls: its walls.
        plan: its whole footprint.
        datum: height of its lowest ground, metres.
    """

    building: MappedBuilding
    volumes: Sequence[Volume]
    walls: Sequence[Wall]
    plan: Geometry
    datum: float
