"""The ground of a junction that its sensors are to see: lanes and crossings, as points above it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from urbantwin.lidar.coverage import LEVEL_M
from urbantwin.roads import RoadNetwork
from urbantwin.site.pole_site import JUNCTION_M

__all__ = ["JunctionGround", "ground_in_plan", "ground_of_network"]

#: Side of the squares that the ground is taken in, metres.
CELL_M = 2.0


@dataclass(frozen=True, eq=False)
class JunctionGround:
    """Lanes and crossings around the middle of a junction, in squares.

    Attributes:
        points: (M, 3) the middle of each square, `LEVEL_M` above the road: where the body of a car
            or of a person would be. Site frame, metres.
        middle: (2,) of the junction.
    """

    points: NDArray[np.float64]
    middle: NDArray[np.float64]

    @property
    def area_m2(self) -> float:
        """Area of the squares."""
        return len(self.points) * CELL_M**2


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
