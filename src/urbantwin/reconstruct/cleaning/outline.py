"""Where a vehicle meets the ground, and the ground under it."""

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

#: Cells of the close look at one vehicle, metres.
_FINE_M = 0.1
#: How far around a vehicle's cells its skirt and the ground beside it are looked at, metres.
_AROUND_M = 2.6
#: Cells from one to the next height whose difference gives a slope.
_RUN = 4
#: Width of the strip around it that gives the street's slope, metres, and its fewest cells.
_STRIP_M, _FEWEST = 2.0, 30
#: What is higher over the ground is a vehicle's for certain, metres.
_SURE_M = 0.25
#: Where a scan melts a flank into the street the surface still falls outwards by this per cell.
_FALLS_M = 0.02
#: What is lower over the street than this is the street's roughness, metres.
_SKIRT_M = 0.08
#: A skirt lower than this is lost in it in any case, metres.
_LOST_M = 0.015
#: Farthest that a skirt reaches, cells.
_SKIRT = 8
#: What lies farther off the surface than this is beyond a step: a curb, metres.
_STEP_M = 0.08
#: And than this, or three times the surface's own roughness, metres.
_ROUGH_M = 0.02
#: Share of the rim that lies on one surface if there is no step. A tilted plane through a street on
#: one side and a sidewalk on the other leaves the short ends off.
_ONE_SURFACE = 0.97
#: Most rim points that an interpolation takes.
_MOST = 250


@dataclass(frozen=True, eq=False)
class Ground:
    """The ground under a vehicle, from the ground around it.

    A thin-plate spline (Duchon 1977): the smoothest surface through given heights; it repeats a
    plane of any slope exactly. It is kept within the heights that it was made from.
    """

    spline: RBFInterpolator
    low: float
    high: float

    @classmethod
    def through(cls, points: NDArray[np.float64]) -> Ground | None:
        """Return the surface through points (N, 3), or ``None`` where they are too few."""
        if len(points) > _MOST:
            points = points[np.linspace(0, len(points) - 1, _MOST).round().astype(int)]
        _, once = np.unique(np.round(points[:, :2], 4), axis=0, return_index=True)
        points = points[np.sort(once)]
        spread = np.linalg.svd(points[:, :2] - points[:, :2].mean(axis=0), compute_uv=False)
        if len(points) < 4 or spread[-1] < 0.05:
            return None
        # Smoothed: a scan's noise at the rim must not swing up in the middle. Planes stay exact.
        spline = RBFInterpolator(
            points[:, :2], points[:, 2], kernel="thin_plate_spline", degree=1, smoothing=10.0
        )
        return cls(spline, float(points[:, 2].min()), float(points[:, 2].max()))

    def at(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return heights (N,) at places (N, 2)."""
        if not len(xy):
            return np.zeros(0)
        return np.asarray(np.clip(self.spline(xy), self.low, self.high))


def _to_the_foot(
    mask: NDArray[np.bool_],
    foreign: NDArray[np.bool_],
    top: NDArray[np.float64],
    height: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Grow a vehicle's cells down its melted skirt until that is lost in the street's roughness."""
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
    """The slope of the street about a vehicle: rise along x and along y."""

    slope: NDArray[np.float64]

    @classmethod
    def around(cls, top: NDArray[np.float64], known: NDArray[np.bool_]) -> Plane:
        """Return the slope that most of the ground around has.

        The median of differences over a few cells: street and sidewalk slope alike, and a curb
        between them is in few of the differences.

        Args:
            top: (rows, columns) heights, cells of ``_FINE_M``.
            known: which of them are ground.
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
        """Return which of points (N, 3) around a vehicle are of the surface it stands on.

        A sidewalk on one side is a curb higher. Of two surfaces a vehicle stands on the lower.
        """
        if len(points) < 12:
            return np.ones(len(points), bool)
        off = _off_most(points, np.ones(len(points), bool))
        good = off < max(_ROUGH_M, 3.0 * float(np.median(off)))
        if good.mean() > _ONE_SURFACE:
            return np.asarray(good)
        over = points[:, 2] - points[:, :2] @ self.slope
        even = np.abs(over - np.percentile(over, 30)) < _STEP_M
        # Of those, what most agree on: the face of a curb lies between street and sidewalk.
        off = _off_most(points, even)
        return np.asarray(even & (off < max(_ROUGH_M, 3.0 * float(np.median(off[even])))))


def _off_most(points: NDArray[np.float64], some: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return how far points (N, 3) are off the quadratic of least absolute deviations of some."""
    return np.asarray(np.abs(_over_most(points, some)))


def _over_most(points: NDArray[np.float64], some: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return how far points (N, 3) are over the quadratic of least absolute deviations of some."""
    x, y = (points[:, :2] - points[some, :2].mean(axis=0)).T
    terms = np.column_stack([np.ones(len(x)), x, y, x * x, x * y, y * y])
    own, height = terms[some], points[some, 2]
    weight = np.ones(len(own))
    best = np.zeros(0)
    for degree in [3] * 10 + [6] * 10:  # a plane first: a quadratic could bend to a curb
        used = own[:, :degree]
        weighted = (used * weight[:, None]).T
        # Normal equations: a few metres of street are far from ill-conditioned, and they are fast.
        best = np.linalg.solve(weighted @ used + 1e-8 * np.eye(degree), weighted @ height)
        weight = 1.0 / np.maximum(np.abs(height - used @ best), 1e-3)
    return np.asarray(points[:, 2] - terms @ best)


@dataclass(frozen=True, eq=False)
class Outline:
    """Where a vehicle meets the ground.

    Attributes:
        area: in plan: everything of it lies inside.
        ground: the ground under it.
        top: greatest height of it, metres.
        covered: the surface goes on under it, so that nothing is to be closed.
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
    """Measure a vehicle closely: its outline on the ground, and the ground around it.

    Args:
        rays: into the mesh.
        seed: where it surely is, in plan.
        bare: (N,) rough heights of the street about it.
        places: (N, 2) where those are.
        reach_m: how far over the street to begin.

    Returns:
        ``None`` where too little of the ground around it is to be seen.
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
    # Poles beside it stay: a cell far above the rest of it is not its own.
    level = float(np.percentile(height[mask], 95))
    foreign = binary_dilation(height > level + 0.8, np.ones((3, 3), bool))
    mask &= ~foreign
    seen = np.where(np.isnan(top), np.inf, top)
    for _ in range(_SKIRT):
        # From what is still over the street: its own roughness is no skirt.
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
