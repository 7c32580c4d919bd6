"""The ground of pedestrians: obstacles near their paths, and footways."""

from __future__ import annotations

import numpy as np
import shapely
from affine import Affine
from numpy.typing import NDArray
from rasterio.features import rasterize
from scipy.ndimage import binary_dilation, distance_transform_edt, uniform_filter1d

from urbantwin.traffic.compiled.asides import BESIDE_M
from urbantwin.traffic.compiled.crowd import MOST_M
from urbantwin.traffic.compiled.ways_round import shortest_way
from urbantwin.traffic.paths.box_plan import PlanBoxes
from urbantwin.traffic.paths.footing import BODY_M

__all__ = [
    "AROUND_M",
    "OFF",
    "ROOM_M",
    "SOLID",
    "Solids",
    "WalkedCells",
    "WalkedGround",
    "box_rows",
]

#: Distance of pedestrians' centres from obstacles, metres.
ROOM_M = 0.4
#: Distance from paths within which obstacles are considered, metres.
_OBSTACLE_RANGE_M = 12.0
#: Resolution of paths for that search, metres.
_SEARCH_CELL_M = 4.0
#: Number of points processed together.
_POINTS_AT_ONCE = 1 << 17
#: Share of footway below which a courtyard counts as solid.
_COURTYARD_SHARE = 0.2


class Solids:
    """Outlines of walls, posts and furniture near pedestrians' paths, with clearance.

    Walls of a scene are plates with two sides, between which a pedestrian would be led into a
    house. Joined, they have one outside.

    Args:
        blocks: obstacles in plan.
        points: (N, 2) positions of pedestrians, site frame.
        footway: footways, which are never solid.
    """

    def __init__(
        self, blocks: PlanBoxes, points: NDArray[np.float64], footway: shapely.Geometry
    ) -> None:
        outlines = []
        if len(blocks.yaw) and len(points):
            shapes = blocks.polygons
            # In parts, to limit memory.
            parts = [
                points[k : k + _POINTS_AT_ONCE] for k in range(0, len(points), _POINTS_AT_ONCE)
            ]
            part_cells = [np.unique(np.round(part / _SEARCH_CELL_M), axis=0) for part in parts]
            cells = np.unique(np.concatenate(part_cells), axis=0) * _SEARCH_CELL_M
            tree = shapely.STRtree(shapely.points(cells))
            nearby = tree.query(shapes, predicate="dwithin", distance=_OBSTACLE_RANGE_M)[0]
            wide = shapely.buffer(shapes[np.unique(nearby)], ROOM_M, quad_segs=2)
            outlines = [
                _filled(outline, footway) for outline in shapely.get_parts(shapely.union_all(wide))
            ]
        self.shapes: NDArray[np.object_] = np.array(outlines, object)
        shapely.prepare(self.shapes)
        self.tree = shapely.STRtree(self.shapes)


def _filled(part: shapely.Polygon, footway: shapely.Geometry) -> shapely.Polygon:
    """Return an outline without courtyards that have little footway."""
    courts = [shapely.Polygon(ring) for ring in part.interiors]
    courtyards = [
        court.exterior
        for court in courts
        if shapely.intersection(court, footway).area > _COURTYARD_SHARE * court.area
    ]
    return shapely.Polygon(part.exterior, courtyards)


#: Values of a cell: an obstacle, or no footway; 0 is free.
SOLID, OFF = 1, 2
#: Size of the cells, metres.
_CELL_M = 0.2
#: Cost of a metre off the footway, in metres on it.
_OFF_FOOTWAY_COST = 4.0
#: Search range of detours around their ends, and maximum length, metres: if it is longer, the scene
#: lacks a passage.
AROUND_M, _MAX_DETOUR_M = 10.0, 30.0
#: Number of cells over which a path is smoothed.
_SMOOTHING_CELLS = 5


class WalkedCells:
    """Raster around pedestrians' paths.

    Args:
        points: (N, 2) positions of pedestrians, site frame.
        solids: outlines of obstacles.
        footway: area that pedestrians prefer.
        margin_m: margin around the points, metres.
    """

    def __init__(
        self,
        points: NDArray[np.float64],
        solids: NDArray[np.object_],
        footway: shapely.Geometry,
        margin_m: float,
    ) -> None:
        ends = points if len(points) else np.zeros((1, 2))
        low, high = ends.min(axis=0) - margin_m, ends.max(axis=0) + margin_m
        shape = tuple(int(n) for n in np.ceil((high - low) / _CELL_M)[::-1])
        # Rows go from south to north, unlike those of the raster.
        grid = Affine(_CELL_M, 0.0, low[0], 0.0, -_CELL_M, low[1] + shape[0] * _CELL_M)
        cells = np.full(shape, OFF, np.uint8)
        if not footway.is_empty:
            cells = rasterize([(footway, 0)], shape, fill=OFF, transform=grid, dtype=np.uint8)
        outlines = [(solid, SOLID) for solid in solids if not solid.is_empty]
        if outlines:
            rasterize(outlines, out=cells, transform=grid)
        self.cells = np.ascontiguousarray(cells[::-1])
        self.corner = np.array([*low, _CELL_M])

    def _of(self, points: NDArray[np.float64]) -> NDArray[np.int64]:
        cell = ((points - self.corner[:2]) / _CELL_M).astype(np.int64)[..., ::-1]
        return np.asarray(np.clip(cell, 0, np.array(self.cells.shape) - 1))

    def at(self, points: NDArray[np.float64]) -> NDArray[np.uint8]:
        """Return the values at points (N, 2)."""
        row, column = self._of(points).T
        return np.asarray(self.cells[row, column])

    def way(
        self, first: NDArray[np.float64], last: NDArray[np.float64]
    ) -> NDArray[np.float64] | None:
        """Return the path (K, 2) between two points around obstacles; ``None`` if there is none.

        An end within an obstacle is moved to the nearest free cell.
        """
        ends = self._of(np.array([first, last]))
        reach = round(AROUND_M / _CELL_M)
        low = np.maximum(ends.min(axis=0) - reach, 0)
        high = np.minimum(ends.max(axis=0) + reach + 1, self.cells.shape)
        part = self.cells[low[0] : high[0], low[1] : high[1]]
        if (part == SOLID).all():
            return None
        nearest = distance_transform_edt(part == SOLID, return_distances=False, return_indices=True)
        start, goal = (nearest[:, row, column] for row, column in (ends - low).tolist())
        cost = np.array([1.0, np.inf, _OFF_FOOTWAY_COST])[part]
        cells = shortest_way(cost, start.astype(np.int64), goal.astype(np.int64))
        if not len(cells) or len(cells) * _CELL_M > _MAX_DETOUR_M:
            return None
        line = self.corner[:2] + ((cells + low)[:, ::-1] + 0.5) * _CELL_M
        return np.asarray(uniform_filter1d(line, _SMOOTHING_CELLS, axis=0, mode="nearest"))


#: Size of the cells for the look-up of obstacles, metres.
_STILL_CELL_M = 2.0
#: Least distance of centres from obstacles in narrow places, metres.
_MIN_OBSTACLE_DISTANCE_M = 0.1


class WalkedGround:
    """Static surroundings of pedestrians.

    Attributes:
        boxes: (B, 7) obstacles on the ground, see ``compiled.crowd.walked``, like the following.
        still: begin of the indices of obstacles for each cell.
        numbers: these indices.
        within: the grid of these cells.
        cells: raster of obstacles and footways.

    Args:
        xy: (N, 2) positions of pedestrians, site frame.
        blocks: obstacles on the ground.
        solids: outlines of obstacles for pedestrians.
        footway: area that pedestrians on it do not leave.
    """

    def __init__(
        self,
        xy: NDArray[np.float64],
        blocks: PlanBoxes,
        solids: NDArray[np.object_],
        footway: shapely.Geometry,
    ) -> None:
        self.boxes = box_rows(blocks.xy, blocks.yaw, blocks.half)
        points = xy if len(xy) else np.zeros((1, 2))
        self.still, self.numbers, self.within = _still_cells(points, blocks)
        inner = shapely.buffer(solids, _MIN_OBSTACLE_DISTANCE_M - ROOM_M)
        self.cells = WalkedCells(points, inner, footway, MOST_M + 1.0)
        self._beside_road = shapely.buffer(footway, -BODY_M)
        shapely.prepare(self._beside_road)

    def on_footway(self, xy: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which points (K, 2) are on the footway, with room for a body."""
        return np.asarray(shapely.contains_xy(self._beside_road, *xy.T), np.bool_)


def box_rows(
    xy: NDArray[np.float64], yaw: NDArray[np.float64], half: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return boxes as rows (N, 7), see ``compiled.crowd.walked``."""
    return np.column_stack([xy, np.cos(yaw), np.sin(yaw), half, np.hypot(*half.T)])


def _still_cells(
    xy: NDArray[np.float64], blocks: PlanBoxes
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Return the obstacles near each cell with pedestrians, see ``compiled.crowd.walked``."""
    low = xy.min(axis=0) - 2 * _STILL_CELL_M
    cell = ((xy - low) / _STILL_CELL_M).astype(np.int64)
    shape = cell.max(axis=0) + 3
    used = np.zeros(shape[::-1], np.bool_)
    used[cell[:, 1], cell[:, 0]] = True
    row, column = np.nonzero(binary_dilation(used, np.ones((3, 3), np.bool_)))
    west, south = low[0] + column * _STILL_CELL_M, low[1] + row * _STILL_CELL_M
    squares = shapely.box(west, south, west + _STILL_CELL_M, south + _STILL_CELL_M)
    tree = shapely.STRtree(blocks.polygons)
    which, block = tree.query(squares, predicate="dwithin", distance=BESIDE_M)
    order = np.lexsort([block, which])
    counts = np.zeros(int(shape.prod()) + 1, np.int64)
    number = row * shape[0] + column
    np.add.at(counts, number[which] + 1, 1)
    # Cells are numbered by row, like the squares.
    return (
        np.cumsum(counts),
        block[order].astype(np.int64),
        np.array([*low, _STILL_CELL_M, *shape], np.float64),
    )
