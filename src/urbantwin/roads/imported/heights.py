"""Heights of an imported map: shift to the site, levels, and ground between roads."""

from __future__ import annotations

import contextlib
import dataclasses
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.interpolate import LinearNDInterpolator
from scipy.ndimage import gaussian_filter
from scipy.spatial import QhullError, cKDTree

from urbantwin.ground import Elevation
from urbantwin.roads.model import LaneModel, ModelRoad

__all__ = ["ModelSurface", "elevation_of_model", "is_flat", "on_one_level", "raised", "with_levels"]

#: A map with a smaller range of heights counts as flat, metres.
FLAT_M = 0.05
#: Spacing of samples along roads, metres.
STEP_M = 2.0
#: Minimum height of a road above another that it passes over, metres (trucks need a clearance of 4
#: m; maps draw bridges of less).
OVER_M = 2.5
#: Tolerance of the convex hull for rounding, metres.
HULL_RIM_M = 1e-3
#: The ground is not raised to a bridge within this distance of the road below, metres.
UNDER_M = 6.0
#: Cell size of the ground's grid, metres, and the maximum number of cells, beyond which cells grow.
GRID_M, MOST_CELLS = 1.0, 1_500_000
#: Number of heights on a ring around the map, and the stride of the road samples that they average.
RING, RING_EVERY = 64, 7
#: Ground within the first distance of a road is exact, beyond the second it is smoothed with the
#: third, metres.
NEAR_M, FAR_M, SMOOTHING_M = 3.0, 15.0, 5.0
#: Margin of the grid beyond the region, metres.
RIM_M = 10.0


def is_flat(model: LaneModel) -> bool:
    """Return whether a map has no heights: constant elevation of all roads."""
    heights = [road.elevation.at(np.linspace(0.0, road.length, 9)) for road in model.roads]
    return not heights or float(np.ptp(np.concatenate(heights))) < FLAT_M


def raised(model: LaneModel, by: float) -> LaneModel:
    """Return the model raised by a height, metres."""
    step = np.array([by, 0.0, 0.0, 0.0])
    roads = tuple(
        dataclasses.replace(
            road, elevation=dataclasses.replace(road.elevation, abcd=road.elevation.abcd + step)
        )
        for road in model.roads
    )
    signals = tuple(
        dataclasses.replace(signal, pose=(*signal.pose[:2], signal.pose[2] + by, signal.pose[3]))
        if signal.pose
        else signal
        for signal in model.signals
    )
    return dataclasses.replace(model, roads=roads, signals=signals)


def on_one_level(model: LaneModel) -> LaneModel:
    """Return the model with all roads and junctions on the ground level."""
    return dataclasses.replace(
        model,
        roads=tuple(dataclasses.replace(road, level=0) for road in model.roads),
        junctions=tuple(dataclasses.replace(junction, level=0) for junction in model.junctions),
    )


def with_levels(model: LaneModel) -> LaneModel:
    """Return the model with each road's level: one more than that of the roads below it.

    A connecting road is on its junction's level, which is the lowest of its connecting roads.
    """
    samples = {road.id: _samples(road) for road in model.roads}
    roads_below: dict[int, set[int]] = {road.id: set() for road in model.roads}
    areas = [shapely.MultiPoint(samples[road.id][:, :2]).convex_hull for road in model.roads]
    tree = shapely.STRtree(areas)
    beside = _joined(model)
    for a, b in tree.query(areas, predicate="intersects").T.tolist():
        upper, lower = model.roads[a], model.roads[b]
        if a == b or upper.id in beside.get(lower.id, ()):
            continue
        upper_points, other = samples[upper.id], samples[lower.id]
        gap, nearest = cKDTree(other[:, :2]).query(upper_points[:, :2])
        rise = upper_points[:, 2] - other[nearest, 2]
        if bool(((gap < STEP_M) & (rise > OVER_M)).any()):
            roads_below[upper.id].add(lower.id)
    level = dict.fromkeys(roads_below, 0)
    for _ in range(8):  # sufficient number of stacked levels
        before = dict(level)
        for upper, lowers in roads_below.items():
            level[upper] = max([level[upper], *(level[lower] + 1 for lower in lowers)])
        if level == before:
            break
    of_junction = {
        junction.id: min(
            (level[c.connecting] for c in junction.connections if c.connecting in level), default=0
        )
        for junction in model.junctions
    }
    roads = tuple(
        dataclasses.replace(road, level=of_junction.get(road.junction, level[road.id]))
        for road in model.roads
    )
    junctions = tuple(
        dataclasses.replace(junction, level=of_junction[junction.id])
        for junction in model.junctions
    )
    return dataclasses.replace(model, roads=roads, junctions=junctions)


class ModelSurface:
    """Heights of the road surface, interpolated between roads and extended beyond them.

    Args:
        model: the lane model, with levels.
    """

    def __init__(self, model: LaneModel) -> None:
        self._samples = [(road, _samples(road)) for road in model.roads]
        self._levels: dict[int, _Sheet] = {}

    def __call__(self, xy: NDArray[np.float64], level: int) -> NDArray[np.float64]:
        """Return heights (N,) at points (N, 2) on a level, metres."""
        if level not in self._levels:
            on_level = [points for road, points in self._samples if road.level == level]
            points = on_level or [points for _, points in self._samples]
            self._levels[level] = _Sheet(np.vstack(points))
        return self._levels[level](xy)

    @cached_property
    def points(self) -> NDArray[np.float64]:
        """Points (N, 3) on roads on the ground: all except those that pass over others."""
        low = [points for road, points in self._samples if road.level == 0]
        high = [points for road, points in self._samples if road.level > 0]
        if not low:
            return np.vstack(high)
        parts = [np.vstack(low)]
        tree = cKDTree(parts[0][:, :2])
        for points in high:
            distance_m, _ = tree.query(points[:, :2])
            parts.append(points[distance_m > UNDER_M])
        return np.vstack(parts)


class _Sheet:
    """A surface through points (N, 3): linear between them, constant from the nearest beyond."""

    def __init__(self, points: NDArray[np.float64]) -> None:
        places = np.unique(np.round(points[:, :2], 2), axis=0, return_index=True)[1]
        points = points[np.sort(places)]
        self._height = points[:, 2]
        self._tree = cKDTree(points[:, :2])
        self._planes = None
        if float(np.ptp(points[:, 2])) > 1e-9:
            # Collinear points have no triangulation; the nearest point is as good.
            with contextlib.suppress(QhullError):
                self._planes = LinearNDInterpolator(points[:, :2], points[:, 2])
                # Beyond the hull the search would try all triangles.
                self._hull = shapely.MultiPoint(points[:, :2]).convex_hull.buffer(HULL_RIM_M)
                shapely.prepare(self._hull)

    def __call__(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        xy = np.asarray(xy, np.float64).reshape(-1, 2)
        if self._planes is None:
            return np.asarray(self._height[self._tree.query(xy)[1]])
        z = np.full(len(xy), np.nan)
        within = shapely.contains_xy(self._hull, xy[:, 0], xy[:, 1])
        z[within] = self._planes(xy[within])
        beyond = np.isnan(z)
        z[beyond] = self._height[self._tree.query(xy[beyond])[1]]
        return z


def elevation_of_model(model: LaneModel, region: shapely.Polygon) -> Elevation:
    """Return the ground that a map's roads imply.

    Heights on roads are exact. Between them they are linear over the Delaunay triangulation of
    points on the roads and on a ring far outside. Heights on the ring are averages of the roads' by
    inverse squared distance. Away from roads the creases of the triangles are smoothed.

    Args:
        model: the lane model, with heights and levels.
        region: the area to cover, site frame.
    """
    west, south, east, north = region.buffer(RIM_M).bounds
    step = max(GRID_M, float(np.sqrt((east - west) * (north - south) / MOST_CELLS)))
    x = np.arange(np.floor(west), east + step, step)
    y = np.arange(np.floor(south), north + step, step)
    grid = np.column_stack([axis.ravel() for axis in np.meshgrid(x, y)])
    points = ModelSurface(model).points
    middle, reach = grid.mean(axis=0), float(np.ptp(grid, axis=0).max())
    angle = np.linspace(0.0, 2 * np.pi, RING, endpoint=False)
    ring = middle + reach * np.column_stack([np.cos(angle), np.sin(angle)])
    weight = 1.0 / np.sum((ring[:, None] - points[None, ::RING_EVERY, :2]) ** 2, axis=2)
    z = (weight * points[::RING_EVERY, 2]).sum(axis=1) / weight.sum(axis=1)
    sheet = _Sheet(np.vstack([points, np.column_stack([ring, z])]))
    exact = sheet(grid).reshape(len(y), len(x))
    distance_m = cKDTree(points[:, :2]).query(grid)[0].reshape(exact.shape)
    share = np.clip((distance_m - NEAR_M) / (FAR_M - NEAR_M), 0.0, 1.0)
    smooth = gaussian_filter(exact, SMOOTHING_M / step, mode="nearest")
    return Elevation(float(x[0]), float(y[0]), step, exact + share * (smooth - exact))


def _samples(road: ModelRoad) -> NDArray[np.float64]:
    """Return points (N, 3) on the borders of a road's lanes."""
    points = []
    for section, end in zip(road.sections, road.section_ends, strict=True):
        s = np.linspace(section.s, end, max(2, int((end - section.s) / STEP_M) + 2))
        borders = [road.offset.at(s)]
        borders += [road.border(section, lane, s, outer=True) for lane in section.lanes]
        points += [road.place(s, t / np.cos(road.bank.at(s))) for t in borders]
    return np.vstack(points)


def _joined(model: LaneModel) -> dict[int, set[int]]:
    """Return each road's neighbours: linked roads, and the connecting roads of its junction."""
    neighbours: dict[int, set[int]] = {road.id: set() for road in model.roads}
    for road in model.roads:
        for link in (road.predecessor, road.successor):
            if link and link.element == "road" and link.id in neighbours:
                neighbours[road.id].add(link.id)
                neighbours[link.id].add(road.id)
    for junction in model.junctions:
        connecting = {c.connecting for c in junction.connections} & set(neighbours)
        for road_id in connecting:
            neighbours[road_id] |= connecting
    return neighbours
