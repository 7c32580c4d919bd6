"""The space swept by vehicles on the lanes, kept free of objects of the scene."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import LabelledMesh
from urbantwin.roads import Lane, RoadNetwork

__all__ = ["SweptLanes"]

#: Range of heights above a lane in which objects are obstacles, metres: vehicles drive over lower
#: curbs and under higher objects. Signs and arms of signals are at 4.5 m and more.
FROM_M, UNTIL_M = 0.2, 3.3
#: Height above the lane from which obstacles are removed, metres.
STUMP_M = -0.5
#: Width of the outer part of a lane on each side that vehicles rarely use, metres.
MARGIN_M = 0.2
#: Maximum length of the pieces into which triangles are cut before removal, metres.
PIECE_M = 0.5
#: An object smaller than this in plan is removed as a whole, metres: a post without its base would
#: float.
SMALL_M = 1.5
KINDS, MOTOR = ("driving", "bus", "connection"), {"car", "van", "truck", "bus", "motorcycle"}


class SweptLanes:
    """The space above the lanes of motor vehicles.

    Args:
        network: the lanes.
    """

    def __init__(self, network: RoadNetwork) -> None:
        lanes = [
            lane for lane in network.lanes
            if lane.kind in KINDS and MOTOR & set(lane.allowed) and len(lane.centre) > 1
        ]  # fmt: skip
        half = [(lane.widths if len(lane.widths) else np.array([lane.width])) / 2 for lane in lanes]
        wide = [k for k, width in enumerate(half) if width.mean() > 2 * MARGIN_M]
        self._lanes: list[Lane] = [lanes[k] for k in wide]
        self._areas = shapely.buffer(
            [shapely.LineString(lane.centre[:, :2]) for lane in self._lanes],
            [float(half[k].mean()) - MARGIN_M for k in wide],
            cap_style="flat",
        )
        shapely.prepare(self._areas)
        self._low = np.array([lane.centre[:, 2].min() for lane in self._lanes])
        self._high = np.array([lane.centre[:, 2].max() for lane in self._lanes])

    def clear(self, mesh: LabelledMesh, *, whole_parts: bool = False) -> tuple[LabelledMesh, int]:
        """Return a mesh without objects on lanes, and the number of triangles cut or removed.

        The ground itself is kept. Triangles that extend into the space of a lane are cut into
        pieces, and the pieces within it are removed.

        Args:
            mesh: part of a scene.
            whole_parts: whether parts that are small in plan are removed as a whole.
        """
        corners = mesh.triangles()
        row, lane = self._near(mesh)
        touched = [
            k
            for k in np.unique(row).tolist()
            if self._within(lane[row == k], _cut(corners[k]), FROM_M).any()
        ]
        if not touched:
            return mesh, 0
        # Objects on a lane are removed down to the ground.
        parts = np.unique(mesh.part[touched])
        left_out = np.zeros(len(mesh.faces), np.bool_)
        clipped = []
        for k in np.unique(row[np.isin(mesh.part[row], parts)]).tolist():
            cut = _cut(corners[k])
            inside = self._within(lane[row == k], cut, STUMP_M)
            if inside.any():
                left_out[k] = True
                clipped.append(_like(mesh, k, cut[~inside]))
        if whole_parts:
            for part in parts[parts > 0].tolist():
                own = mesh.part == part
                if np.ptp(corners[own][..., :2].reshape(-1, 2), axis=0).max() < SMALL_M:
                    left_out |= own
                    clipped = [piece for piece in clipped if (piece.part != part).all()]
        return LabelledMesh.concatenate([mesh.select(~left_out), *clipped]), int(left_out.sum())

    def _within(
        self, lanes: NDArray[np.int64], pieces: NDArray[np.float64], from_m: float
    ) -> NDArray[np.bool_]:
        """Return which triangles (N, 3, 3) have a corner above any of the lanes."""
        points = pieces.reshape(-1, 3)
        found = np.zeros(len(points), np.bool_)
        for number in lanes.tolist():
            found |= self._inside(number, points, from_m)
        return np.asarray(found.reshape(-1, 3).any(axis=1))

    def _near(self, mesh: LabelledMesh) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return triangles that may reach into the space of lanes, and the numbers of these."""
        mine = np.flatnonzero(~mesh.is_ground)
        if not (len(mine) and len(self._lanes)):
            return np.zeros(0, np.int64), np.zeros(0, np.int64)
        corners = mesh.triangles()[mine]
        low, high = corners.min(axis=1), corners.max(axis=1)
        boxes = shapely.box(low[:, 0], low[:, 1], high[:, 0], high[:, 1])
        lane, row = shapely.STRtree(boxes).query(self._areas, predicate="intersects")
        near = (high[row, 2] > self._low[lane] + FROM_M) & (
            low[row, 2] < self._high[lane] + UNTIL_M
        )
        return mine[row[near]], lane[near]

    def _inside(self, number: int, points: NDArray[np.float64], from_m: float) -> NDArray[np.bool_]:
        """Return which points (N, 3) are above a lane, from a height on."""
        found = shapely.contains_xy(self._areas[number], points[:, 0], points[:, 1])
        if found.any():
            centre = self._lanes[number].centre
            line = shapely.LineString(centre[:, :2])
            at = shapely.line_locate_point(line, shapely.points(points[found, :2]))
            steps = np.linalg.norm(np.diff(centre[:, :2], axis=0), axis=1)
            station = np.concatenate([[0.0], np.cumsum(steps)])
            above = points[found, 2] - np.interp(at, station, centre[:, 2])
            found[found] = (above > from_m) & (above < UNTIL_M)
        return np.asarray(found)


def _cut(triangle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a triangle (3, 3) in equal pieces (N, 3, 3), with equal numbers per side."""
    sides = np.linalg.norm(triangle - np.roll(triangle, 1, axis=0), axis=1)
    count = max(int(np.ceil(sides.max() / PIECE_M)), 1)
    a, b, c = triangle
    steps = np.arange(count + 1) / count
    nodes = a + steps[:, None, None] * (b - a) + steps[None, :, None] * (c - a)
    i, j = np.nonzero(np.add.outer(np.arange(count), np.arange(count)) < count)
    upright = np.stack([nodes[i, j], nodes[i + 1, j], nodes[i, j + 1]], axis=1)
    turned = i + j < count - 1
    i, j = i[turned], j[turned]
    other = np.stack([nodes[i + 1, j], nodes[i + 1, j + 1], nodes[i, j + 1]], axis=1)
    return np.concatenate([upright, other])


def _like(mesh: LabelledMesh, face: int, pieces: NDArray[np.float64]) -> LabelledMesh:
    """Return triangles (N, 3, 3) with the labels of a triangle of a mesh."""
    count = len(pieces)
    return LabelledMesh(
        pieces.reshape(-1, 3),
        np.arange(3 * count, dtype=np.int32).reshape(-1, 3),
        np.repeat(mesh.semantic[face], count),
        np.repeat(mesh.material[face], count),
        np.repeat(mesh.part[face], count),
    )
