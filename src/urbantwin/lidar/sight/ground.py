"""The ground of a junction as squares to be seen, and positions for poles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from urbantwin.geometry import DownwardProbe, LabelledMesh, area_union
from urbantwin.lidar.sight.cells import LEVEL_M
from urbantwin.roads import RoadNetwork
from urbantwin.site.pole_site import JUNCTION_M
from urbantwin.taxonomy import material_id, semantic_id

__all__ = ["CELL_M", "JunctionGround", "ground_in_plan", "ground_of_network", "pole_places"]

#: Side of the squares of a junction's ground, metres.
CELL_M = 2.0
#: Poles: least and largest distance from the centre of the junction, and grid spacing, metres.
_NEAREST_M, _FARTHEST_M, _GRID_M = 8.0, 45.0, 1.5
#: Least and largest distance of a pole from a carriageway, metres: clear of mirrors, beside the
#: street.
_KERB_M, _BESIDE_M = 0.6, 8.0
#: Least distance of a pole from the centre line of a footway, metres.
_FOOTWAY_M = 0.7
#: Ground classes on which a pole can stand.
_FOOTING = ("sidewalk", "terrain", "other-ground")


@dataclass(frozen=True, eq=False)
class JunctionGround:
    """Lanes and crossings around the centre of a junction, in squares of `CELL_M`.

    Attributes:
        points: (M, 3) centre of each square, `LEVEL_M` above the road, at the height of a car's or
            person's body. Site frame, metres.
        middle: (2,) centre of the junction.
    """

    points: NDArray[np.float64]
    middle: NDArray[np.float64]

    def numbers(self, places: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return the square (N,) that contains each of places (N, 2); -1 for none."""
        square = np.full(len(places), -1)
        if not len(self.points):
            return square
        cell = np.floor(self.points[:, :2] / CELL_M).astype(np.int64)
        low = cell.min(axis=0)
        table = np.full(cell.max(axis=0) - low + 1, -1)
        table[tuple((cell - low).T)] = np.arange(len(cell))
        place_cell = np.floor(places / CELL_M).astype(np.int64) - low
        inside = ((place_cell >= 0) & (place_cell < table.shape)).all(axis=1)
        square[inside] = table[tuple(place_cell[inside].T)]
        return square

    def on_crossings(self, network: RoadNetwork) -> NDArray[np.bool_]:
        """Return which squares (M,) are on a crossing of a network."""
        areas = [lane.polygon for lane in network.lanes if lane.kind == "crossing"]
        if not areas or not len(self.points):
            return np.zeros(len(self.points), np.bool_)
        area = shapely.union_all(shapely.buffer(np.array(areas, object), 0.0))
        shapely.prepare(area)
        return np.asarray(shapely.dwithin(area, shapely.points(self.points[:, :2]), CELL_M / 2))


def ground_in_plan(area: shapely.Geometry) -> JunctionGround:
    """Return the ground of an area about the origin, without heights."""
    return JunctionGround(_above(_squares(area), 0.0), np.zeros(2))


def ground_of_network(
    network: RoadNetwork, region: shapely.Polygon, middle: NDArray[np.float64]
) -> JunctionGround:
    """Return the ground within `JUNCTION_M` of the centre of a junction.

    Where roads cross on several levels, the level of the lane nearest to the centre counts.

    Args:
        network: the lanes, with heights.
        region: the region of interest.
        middle: (2,) centre of the junction, site frame.
    """
    lanes = [lane for lane in network.lanes if lane.kind != "sidewalk" and len(lane.centre)]
    if not lanes:
        return JunctionGround(np.zeros((0, 3)), middle)
    centres = np.vstack([lane.centre for lane in lanes])
    levels = np.repeat([lane.level for lane in lanes], [len(lane.centre) for lane in lanes])
    level = int(levels[np.argmin(np.linalg.norm(centres[:, :2] - middle, axis=1))])
    disc = shapely.intersection(shapely.Point(middle).buffer(JUNCTION_M), region)
    squares = _squares(shapely.intersection(network.carriageway(level), disc))
    centres = centres[levels == level]
    _, nearest = cKDTree(centres[:, :2]).query(squares)
    return JunctionGround(_above(squares, centres[nearest, 2]), middle)


def _squares(area: shapely.Geometry) -> NDArray[np.float64]:
    """Return the centres (M, 2) of the squares of a fixed grid inside an area."""
    if area.is_empty:
        return np.zeros((0, 2))
    west, south, east, north = area.bounds
    x = np.arange(np.floor(west / CELL_M), np.ceil(east / CELL_M)) * CELL_M + CELL_M / 2
    y = np.arange(np.floor(south / CELL_M), np.ceil(north / CELL_M)) * CELL_M + CELL_M / 2
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    shapely.prepare(area)
    return np.asarray(places[shapely.contains_xy(area, places[:, 0], places[:, 1])])


def _above(
    squares: NDArray[np.float64], height: NDArray[np.float64] | float
) -> NDArray[np.float64]:
    return np.column_stack([squares, np.broadcast_to(height, len(squares)) + LEVEL_M])


def pole_places(
    network: RoadNetwork, region: shapely.Polygon, mesh: LabelledMesh, middle: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return positions for a pole around the centre of a junction.

    At the side of a sidewalk or on open ground, beside a carriageway, not under a deck and not in
    water; buildings and trees are ignored.

    Args:
        network: the lanes.
        region: poles are inside.
        mesh: the static world around.
        middle: (2,) centre of the junction.

    Returns:
        (N, 3) foot of each pole, site frame, and (N,) its distance from the carriageway.
    """
    steps = np.arange(-_FARTHEST_M, _FARTHEST_M + _GRID_M / 2, _GRID_M)
    places = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    away = np.linalg.norm(places, axis=1)
    places = places[(away >= _NEAREST_M) & (away <= _FARTHEST_M)] + middle
    driven = area_union([network.carriageway(level) for level in network.levels])
    walked = [
        shapely.LineString(lane.centre[:, :2])
        for lane in network.lanes
        if lane.kind == "sidewalk" and len(lane.centre) >= 2
    ]
    footways = shapely.union_all(shapely.buffer(np.array(walked, object), _FOOTWAY_M))
    inside = shapely.buffer(region, -1.0)
    shapely.prepare([driven, footways, inside])
    points = shapely.points(places)
    free = shapely.contains(inside, points) & ~shapely.intersects(footways, points)
    free &= shapely.dwithin(driven, points, _BESIDE_M) & ~shapely.dwithin(driven, points, _KERB_M)
    feet = _on_footing(places[free], mesh)
    return feet, shapely.distance(driven, shapely.points(feet[:, :2]))


def _on_footing(places: NDArray[np.float64], mesh: LabelledMesh) -> NDArray[np.float64]:
    """Return the places (N, 2) on ground on which a pole can stand, with its height."""
    ground = mesh.select(mesh.is_ground)
    if not len(places) or not len(ground.faces):
        return np.zeros((0, 3))
    probe = DownwardProbe(ground)
    above = np.column_stack([places, np.full(len(places), ground.vertices[:, 2].max() + 1.0)])
    face = probe.face_below(above)
    firm = np.isin(ground.semantic[face], [semantic_id(name) for name in _FOOTING])
    firm &= (face >= 0) & (ground.material[face] != material_id("water"))
    return np.column_stack([places[firm], probe.height_below(above[firm])])
