"""Outline of a vehicle on the ground, and the ground under it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.interpolate import RBFInterpolator
from scipy.ndimage import binary_dilation, binary_fill_holes, label, maximum_filter
from scipy.spatial import cKDTree

from urbantwin.reconstruct.cleaning.height_grid import Grid
from urbantwin.reconstruct.cleaning.rays import Rays

__all__ = ["Ground", "Outline", "outline_of"]

#: Cell size of the detailed measurement of a vehicle, metres.
_FINE_M = 0.1
#: Margin around a vehicle for its skirt and the ground beside it, metres.
_AROUND_M = 2.6
#: Distance in cells over which slopes are measured.
_RUN = 4
#: Width of the surrounding strip that gives the street's slope, metres, and its minimum number of
#: cells.
_STRIP_M, _FEWEST = 2.0, 30
#: Height above the ground from which a cell certainly belongs to a vehicle, metres.
_SURE_M = 0.25
#: Minimum outward drop per cell of a flank that a scan blends into the street, metres.
_FALLS_M = 0.02
#: Height below which deviations are the street's roughness, metres.
_SKIRT_M = 0.08
#: Height below which a skirt is always indistinguishable, metres.
_LOST_M = 0.015
#: Maximum extent of a skirt, cells.
_SKIRT = 8
#: Deviation from the surface beyond which points are across a step (a curb), metres.
_STEP_M = 0.08
#: Tolerance of the surface, at least three times its own roughness, metres.
_ROUGH_M = 0.02
#: Share of the rim on one surface from which there is no step. A tilted plane through a street on
#: one side and a sidewalk on the other misses the short ends.
_ONE_SURFACE = 0.97
#: Maximum number of rim points of an interpolation.
_MOST = 250


@dataclass(frozen=True, eq=False)
class Ground:
    """The ground under a vehicle, interpolated from the ground around it.

    A thin-plate spline (Duchon 1977): the smoothest surface through given heights, exact for planes
    of any slope. It is clipped to the range of its heights.
    """

    spline: RBFInterpolator
    low: float
    high: float

    @classmethod
    def through(cls, points: NDArray[np.float64]) -> Ground | None:
        """Return the surface through points (N, 3), or ``None`` if there are too few."""
        if len(points) > _MOST:
            points = points[np.linspace(0, len(points) - 1, _MOST).round().astype(int)]
        _, once = np.unique(np.round(points[:, :2], 4), axis=0, return_index=True)
        points = points[np.sort(once)]
        spread = np.linalg.svd(points[:, :2] - points[:, :2].mean(axis=0), compute_uv=False)
        if len(points) < 4 or spread[-1] < 0.05:
            return None
        # Smoothing prevents noise at the rim from overshooting in the middle; planes remain exact.
        spline = RBFInterpolator(
            points[:, :2], points[:, 2], kernel="thin_plate_spline", degree=1, smoothing=10.0
        )
        return cls(spline, float(points[:, 2].min()), float(points[:, 2].max()))

    def at(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return heights (N,) at positions (N, 2)."""
        if not len(xy):
            return np.zeros(0)
        return np.asarray(np.clip(self.spline(xy), self.low, self.high))


def _to_the_foot(
    mask: NDArray[np.bool_],
    foreign: NDArray[np.bool_],
    top: NDArray[np.float64],
    height: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Grow a vehicle's cells down its blended skirt into the street's roughness."""
    known = ~np.isnan(top) & (np.abs(height) < _SURE_M + 0.1) & ~foreign
    strip = known & ~binary_dilation(mask, iterations=5)
    strip &= binary_dilation(mask, iterations=16)
    row, column = np.nonzero(strip)
    if len(row) < _FEWEST:
        return mask
    points = np.column_stack([column * _FINE_M, row * _FINE_M, top[strip]])
    even = Plane.around(top, strip).even(points)
    every = np.column_stack(
        [*(k.ravel() * _FINE_M for k in np.indices(top.shape)[::-1]), top.ravel()]
    )
    both = np.concatenate([points[even], np.nan_to_num(every)])
    chosen = np.arange(len(both)) < int(even.sum())
    over = _over_most(both, chosen)
    rough = float(np.median(np.abs(over[chosen]))) * 1.4826
    above = over[int(even.sum()) :].reshape(top.shape)
    for _ in range(_SKIRT):
        edge = maximum_filter(np.where(mask, above, -np.inf), 3)
        more = ~mask & known & binary_dilation(mask)
        more &= (above > max(_LOST_M, 2.0 * rough)) & (above < edge - 0.005)
        if not more.any():
            break
        mask = mask | more
    return np.asarray(binary_fill_holes(mask))


@dataclass(frozen=True, eq=False)
class Plane:
    """Slope of the street around a vehicle: rise along x and along y."""

    slope: NDArray[np.float64]

    @classmethod
    def around(cls, top: NDArray[np.float64], known: NDArray[np.bool_]) -> Plane:
        """Return the slope of most of the surrounding ground.

        It is the median of differences over a few cells: street and sidewalk have similar slopes,
        and few differences cross the curb between them.

        Args:
            top: (rows, columns) heights, cells of ``_FINE_M``.
            known: mask of the ground cells.
        """
        values = np.where(known, top, np.nan)
        slope = np.zeros(2)
        for axis, far in ((0, values[:, _RUN:]), (1, values[_RUN:])):
            near = values[:, :-_RUN] if axis == 0 else values[:-_RUN]
            rise = (far - near)[~np.isnan(far - near)]
            if len(rise):
                slope[axis] = float(np.median(rise)) / (_RUN * _FINE_M)
        return cls(slope)

    def even(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return the mask of points (N, 3) around a vehicle on the surface under it.

        A sidewalk on one side is higher by a curb. Of two surfaces the vehicle is on the lower one.
        """
        if len(points) < 12:
            return np.ones(len(points), bool)
        off = _off_most(points, np.ones(len(points), bool))
        good = off < max(_ROUGH_M, 3.0 * float(np.median(off)))
        if good.mean() > _ONE_SURFACE:
            return np.asarray(good)
        over = points[:, 2] - points[:, :2] @ self.slope
        even = np.abs(over - np.percentile(over, 30)) < _STEP_M
        # The surface of the majority: the face of a curb is between street and sidewalk.
        off = _off_most(points, even)
        return np.asarray(even & (off < max(_ROUGH_M, 3.0 * float(np.median(off[even])))))


def _off_most(points: NDArray[np.float64], some: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the absolute deviation of points (N, 3) from an L1 quadratic through some of them."""
    return np.asarray(np.abs(_over_most(points, some)))


def _over_most(points: NDArray[np.float64], some: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the height of points (N, 3) above an L1 quadratic through some of them."""
    x, y = (points[:, :2] - points[some, :2].mean(axis=0)).T
    terms = np.column_stack([np.ones(len(x)), x, y, x * x, x * y, y * y])
    own, height = terms[some], points[some, 2]
    weight = np.ones(len(own))
    best = np.zeros(0)
    for degree in [3] * 10 + [6] * 10:  # a plane first, as a quadratic could bend towards a curb
        used = own[:, :degree]
        weighted = (used * weight[:, None]).T
        # Normal equations are fast, and well conditioned for a few metres of street.
        best = np.linalg.solve(weighted @ used + 1e-8 * np.eye(degree), weighted @ height)
        weight = 1.0 / np.maximum(np.abs(height - used @ best), 1e-3)
    return np.asarray(points[:, 2] - terms @ best)


@dataclass(frozen=True, eq=False)
class Outline:
    """The outline of a vehicle on the ground.

    Attributes:
        area: in plan, contains the whole vehicle.
        ground: the ground under it.
        top: its maximum height, metres.
        covered: the surface continues under it, so that no gap has to be closed.
    """

    area: shapely.Polygon
    ground: Ground
    top: float
    covered: bool


def outline_of(
    rays: Rays,
    seed: shapely.Geometry,
    bare: NDArray[np.float64],
    places: NDArray[np.float64],
    reach_m: float,
) -> Outline | None:
    """Return the outline of a vehicle on the ground, and the ground around it.

    Args:
        rays: ray caster of the mesh.
        seed: area certainly covered by the vehicle, in plan.
        bare: (N,) approximate heights of the street around it.
        places: (N, 2) positions of these heights.
        reach_m: start height of rays above the street, metres.

    Returns:
        ``None`` if too little of the surrounding ground is visible.
    """
    west, south, east, north = shapely.buffer(seed, _AROUND_M).bounds
    grid = Grid.over((west, south, east, north), _FINE_M)
    xy = grid.centres()
    rough = bare[cKDTree(places).query(xy)[1]]
    top = rays.heights(xy, rough + reach_m).reshape(grid.shape)
    rough = rough.reshape(grid.shape)
    core = grid.inside(shapely.buffer(seed, 0.3))
    height = np.nan_to_num(top - rough, nan=0.0)
    number, _ = label(height > _SURE_M)
    own = np.unique(number[core & (number > 0)])
    mask = np.isin(number, own[own > 0]) & grid.inside(shapely.buffer(seed, 0.6))
    if not mask.any():
        return None
    # Poles beside it are excluded: their cells are far higher.
    level = float(np.percentile(height[mask], 95))
    foreign = binary_dilation(height > level + 0.8, np.ones((3, 3), bool))
    mask &= ~foreign
    seen = np.where(np.isnan(top), np.inf, top)
    for _ in range(_SKIRT):
        # Growth starts above the street's roughness.
        edge = maximum_filter(np.where(mask & (height > _SKIRT_M), top, -np.inf), 3)
        more = ~mask & ~foreign & (seen < edge - _FALLS_M) & binary_dilation(mask)
        if not more.any():
            break
        mask |= more
    mask = _to_the_foot(binary_fill_holes(mask), foreign, top, height)
    area = shapely.buffer(shapely.buffer(grid.squares(mask), 0.05, join_style="mitre"), 0.0)
    area = max(shapely.get_parts(area), key=lambda part: part.area)
    area = shapely.polygons(shapely.get_exterior_ring(area)).simplify(0.06)
    if area.geom_type != "Polygon" or not area.is_valid or area.is_empty:
        return None
    grown = binary_dilation(mask, iterations=2)
    low = ~grown & ~np.isnan(top) & (np.abs(height) < _SURE_M + 0.1)
    wide = low & binary_dilation(grown, iterations=round(_STRIP_M / _FINE_M))
    if wide.sum() < _FEWEST:
        return None
    plane = Plane.around(top, wide)
    ring = low & binary_dilation(grown, iterations=6)
    around = np.column_stack([grid.centres(ring), top[ring]])
    around = around[plane.even(around)]
    ground = Ground.through(around)
    if ground is None:
        return None
    inner = grid.centres(mask)
    expected = ground.at(inner)
    below = rays.heights(inner, expected - 1.0, up=True)
    layer = np.abs(below - expected) < 0.1
    apart = top[mask] - below > 0.1
    covered = bool((layer & apart).mean() > 0.8)
    return Outline(area, ground, float(np.nanmax(top[mask])), covered)
