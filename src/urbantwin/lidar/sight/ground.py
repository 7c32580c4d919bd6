"""The ground of a junction: the squares that sensors are to see, and where poles can stand."""

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
#: Poles: nearest and farthest distance from the middle of the junction, step of the grid, metres.
_NEAREST_M, _FARTHEST_M, _GRID_M = 8.0, 45.0, 1.5
#: Nearest and farthest distance of a pole from a carriageway: clear of mirrors, beside the street.
_KERB_M, _BESIDE_M = 0.6, 8.0
#: Distance of a pole from the middle of a footway, metres.
_FOOTWAY_M = 0.7
#: Classes of ground that a pole can be set in.
_FOOTING = ("sidewalk", "terrain", "other-ground")


@dataclass(frozen=True, eq=False)
class JunctionGround:
    """Lanes and crossings around the middle of a junction, in squares of `CELL_M`.

    Attributes:
        points: (M, 3) the middle of each square, `LEVEL_M` above the road: where the body of a car
            or of a person would be. Site frame, metres.
        middle: (2,) of the junction.
    """

    points: NDArray[np.float64]
    middle: NDArray[np.float64]

    def numbers(self, places: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return the square (N,) that holds each of places (N, 2); -1 where none does."""
        found = np.full(len(places), -1)
        if not len(self.points):
            return found
        cell = np.floor(self.points[:, :2] / CELL_M).astype(np.int64)
        low = cell.min(axis=0)
        table = np.full(cell.max(axis=0) - low + 1, -1)
        table[tuple((cell - low).T)] = np.arange(len(cell))
        own = np.floor(places / CELL_M).astype(np.int64) - low
        inside = ((own >= 0) & (own < table.shape)).all(axis=1)
        found[inside] = table[tuple(own[inside].T)]
        return found

    def on_crossings(self, network: RoadNetwork) -> NDArray[np.bool_]:
        """Return which squares (M,) lie on a crossing of a network."""
        areas = [lane.polygon for lane in network.lanes if lane.kind == "crossing"]
        if not areas or not len(self.points):
            return np.zeros(len(self.points), np.bool_)
        area = shapely.union_all(shapely.buffer(np.array(areas, object), 0.0))
        shapely.prepare(area)
        return np.asarray(shapely.dwithin(area, shapely.points(self.points[:, :2]), CELL_M / 2))


def ground_in_plan(area: shapely.Geometry) -> JunctionGround:
    """Return the ground of an area in plan about the origin, where the heights are not known."""
    return JunctionGround(_above(_squares(area), 0.0), np.zeros(2))


def ground_of_network(
    network: RoadNetwork, region: shapely.Polygon, middle: NDArray[np.float64]
) -> JunctionGround:
    """Return the ground within `JUNCTION_M` of the middle of a junction.

    Where roads cross on several levels, that of the lane nearest to the middle counts.

    Args:
        network: the lanes, with heights.
        region: the region of interest.
        middle: (2,) of the junction, site frame.
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
    """Return the middles (M, 2) of the squares of a fixed grid that an area holds."""
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
    """Return where a pole could stand around the middle of a junction.

    On a sidewalk's side or on open ground, beside a carriageway and not on it, under no deck, in
    no water; whatever buildings and trees are there.

    Args:
        network: the lanes.
        region: no pole stands outside.
        mesh: the static world around.
        middle: (2,) of the junction.

    Returns:
        (N, 3) the foot of each pole, site frame, and (N,) how far it is from the carriageway.
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
    """Return the places (N, 2) that are on ground which a pole can be set in, with its height."""
    ground = mesh.select(mesh.is_ground)
    if not len(places) or not len(ground.faces):
        return np.zeros((0, 3))
    probe = DownwardProbe(ground)
    above = np.column_stack([places, np.full(len(places), ground.vertices[:, 2].max() + 1.0)])
    face = probe.face_below(above)
    firm = np.isin(ground.semantic[face], [semantic_id(name) for name in _FOOTING])
    firm &= (face >= 0) & (ground.material[face] != material_id("water"))
    return np.column_stack([places[firm], probe.height_below(above[firm])])
