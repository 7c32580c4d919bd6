"""Annotated boxes mended by another sweep of the log: left out where it sees through, else fitted.

A box is drawn around a few points, and the sides that nobody saw are a guess. The rays of another
sweep say where the body's sides are, which of our meshes comes nearest to it, and whether there is
a body at all.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from argoverse_log import SENSORS, ActorBox, Log
from argoverse_world import TIMES_S, actor_class, mesh_in_box, meshes_of
from urbantwin.geometry import Pose
from urbantwin.geometry.rays import RayScene
from urbantwin.taxonomy import material_id
from urbantwin.traffic.assets import COATED_CLASSES

__all__ = ["SweepRays", "mended"]

#: Points lower in a box than this may be of the ground.
GROUND_M = 0.3
#: A box with fewer points above that stays as it was annotated.
FEWEST = 10
#: A ray that ends this far behind a body's opaque surface went through it; with a larger share of
#: such rays, of this many at least, there is no body.
BEHIND_M, EMPTY_SHARE, EMPTY_RAYS = 1.0, 0.7, 20
#: Distances count up to this one: what is farther away is another thing, however far.
FARTHEST_M = 0.4
#: Points this far outside of the annotated box are still looked at.
AROUND_M = 0.4
#: So many points, and twice as many rays, are looked at, at most; so many meshes to the end.
MOST, FINALISTS = 500, 2
#: Standard deviations by which boxes may be off: place ahead and to the left, metres; heading,
#: radians; logarithms of length, width and height; and what one of them costs, metres.
TRUST = np.array([0.3, 0.3, 0.05, 0.1, 0.1, 0.1])
COST_M = 0.005


@dataclass(frozen=True, eq=False)
class SweepRays:
    """The rays of both sensors that returned, in one frame at the sweep's time.

    Attributes:
        origin: (N, 3) where the sensor was.
        point: (N, 3) where the ray ended.
    """

    origin: NDArray[np.float64]
    point: NDArray[np.float64]

    @classmethod
    def of(cls, log: Log, sweep: int) -> SweepRays:
        """The rays of a sweep, vehicle frame."""
        origins, points = [], []
        path = log.vehicle_path(sweep, TIMES_S)
        for name, _, _ in SENSORS:
            rays = log.rays(sweep, name)
            place = np.stack([(pose @ log.mounts[name]).translation for pose in path])
            back = np.isfinite(rays.range_m)
            time_s = rays.time_s[back]
            origins.append(np.column_stack([np.interp(time_s, TIMES_S, p) for p in place.T]))
            points.append(rays.points_m[back])
        return cls(np.concatenate(origins), np.concatenate(points))

    def into(self, box: ActorBox) -> SweepRays:
        """Those that come as far as the box, grown, in its own frame."""
        half = (box.size / 2 + AROUND_M)[:, None]
        inverse = box.pose.inverse()
        start, end = inverse.apply(self.origin), inverse.apply(self.point)
        with np.errstate(divide="ignore", invalid="ignore"):
            one, two = (-half - start.T) / (end - start).T, (half - start.T) / (end - start).T
        enter, leave = np.minimum(one, two).max(axis=0), np.maximum(one, two).min(axis=0)
        comes = (enter < leave) & (enter > 0) & (enter <= 1)
        return SweepRays(start[comes], end[comes])


class _Surface:
    """Triangles to cast rays at."""

    def __init__(self, vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> None:
        self._scene = RayScene(vertices, faces)

    def first(
        self, start: NDArray[np.float64], way: NDArray[np.float64]
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """The triangle that each ray meets first, -1 for none, and after how many of its ways."""
        found = self._scene.cast_single(start, way)
        return found.face.astype(np.int64), found.range_m.astype(np.float64)


@dataclass(frozen=True, eq=False)
class _Body:
    """A mesh of the catalogue that fills a cube of edge 1 around 0, to cast rays at."""

    name: str
    panes: bool
    whole: _Surface
    opaque: _Surface
    is_pane: NDArray[np.bool_]


@cache
def _bodies(category: str) -> tuple[_Body, ...]:
    """The catalogue's meshes of a class, those with panes once more without."""
    found = []
    for name in sorted(meshes_of(category)):
        mesh = mesh_in_box(category, np.ones(3), name=name)
        pane = mesh.material == material_id("glass")
        whole = _Surface(mesh.vertices, mesh.faces)
        opaque = _Surface(mesh.vertices, mesh.faces[~pane]) if pane.any() else whole
        found.append(_Body(name, True, whole, opaque, pane))
        if pane.any():
            found.append(_Body(name, False, whole, whole, np.zeros_like(pane)))
    return tuple(found)


class _Fit:
    """How far a body in a box is from what rays found there."""

    def __init__(self, size: NDArray[np.float64], rays: SweepRays) -> None:
        self.size = size
        self.low = -size[2] / 2 + GROUND_M
        around = (np.abs(rays.point) < size / 2 + AROUND_M).all(axis=1)
        points = rays.point[around & (rays.point[:, 2] > self.low)]
        self.inside = int((np.abs(points) < size / 2).all(axis=1).sum())
        self._tree = cKDTree(points)
        self._points = points[:: -(-len(points) // MOST) or 1]
        thin = -(-len(rays.point) // (2 * MOST)) or 1
        self._from, self._to = rays.origin[::thin], rays.point[::thin]

    def box(self, change: NDArray[np.float64]) -> tuple[Pose, NDArray[np.float64]]:
        """Where the changed box is in the old one, and its size; it stands where it stood."""
        size = self.size * np.exp(change[3:])
        place = np.array([change[0], change[1], (size[2] - self.size[2]) / 2])
        return Pose(Rotation.from_euler("z", change[2]).as_matrix(), place), size

    def _cast(
        self, body: _Body, change: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.float64]]:
        """Where rays (1: at their real end) meet the body; whether in a pane; what is opaque."""
        pose, size = self.box(change)
        inverse = pose.inverse()
        start, end = (inverse.apply(one) / size for one in (self._from, self._to))
        face, first = body.whole.first(start, end - start)
        pane = (face >= 0) & body.is_pane[face]
        opaque = first
        if pane.any():
            opaque = first.copy()
            opaque[pane] = body.opaque.first(start[pane], (end - start)[pane])[1]
        return first, pane, opaque

    def cost(self, change: NDArray[np.float64], body: _Body) -> float:
        """Mean distance, both ways, of what rays would find and what they found, metres."""
        first, pane, opaque = self._cast(body, change)
        # As a simulated ray: through the panes. Some real ones end there, and are of the body too.
        found, on_panes = (
            self._from[some] + reach[some, None] * (self._to - self._from)[some]
            for some, reach in ((np.isfinite(opaque), opaque), (pane, first))
        )
        found = found[found[:, 2] > self.low]
        if len(found) < FEWEST / 2:
            return FARTHEST_M
        of_body = self._tree.query(found, distance_upper_bound=FARTHEST_M)[0]
        of_points = cKDTree(np.concatenate([found, on_panes])).query(
            self._points, distance_upper_bound=FARTHEST_M
        )[0]
        off = sum(float(np.minimum(one, FARTHEST_M).mean()) for one in (of_body, of_points)) / 2
        return off + COST_M * float(((change / TRUST) ** 2).sum())

    def best(self, body: _Body, start: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        """The least cost from a start on, and where it is."""
        simplex = start + np.vstack([np.zeros(6), np.diag(TRUST)])
        options = {"initial_simplex": simplex, "maxfev": 150}
        found = minimize(self.cost, start, (body,), method="Nelder-Mead", options=options)
        return float(found.fun), found.x

    def is_empty(self, body: _Body, change: NDArray[np.float64]) -> bool:
        """Whether most of the rays that the body would stop end well behind it."""
        first, pane, _ = self._cast(body, change)
        stopped = np.isfinite(first) & ~pane
        length = np.linalg.norm(self._to - self._from, axis=1)
        through = (1 - first[stopped]) * length[stopped] > BEHIND_M
        return len(through) >= EMPTY_RAYS and bool(through.mean() > EMPTY_SHARE)


def mended(box: ActorBox, others: list[ActorBox], rays: SweepRays) -> ActorBox | None:
    """The box with the mesh, the place and the size that the rays of another sweep speak for.

    Args:
        box: of the sweep that is simulated.
        others: boxes of the other sweep: the same track is looked for.
        rays: of the other sweep.

    Returns:
        None if that sweep sees through the body.
    """
    other = next((one for one in others if one.name == box.name), None)
    bodies = _bodies(box.category)
    if other is None or not bodies:
        return box
    fit, still = _Fit(box.size, rays.into(other)), np.zeros(6)
    vehicle = actor_class(box.category) in COATED_CLASSES
    if fit.inside < FEWEST:
        return None if vehicle and fit.is_empty(bodies[0], still) else box
    first = min(bodies, key=lambda body: fit.cost(still, body))
    place = fit.best(first, still)[1]
    ranked = sorted(bodies, key=lambda body: fit.cost(place, body))
    found = [(fit.best(body, place), body) for body in ranked[:FINALISTS]]
    (_, change), body = min(found, key=lambda one: one[0][0])
    if vehicle and fit.is_empty(body, change):
        return None
    pose, size = fit.box(change)
    return replace(box, pose=box.pose @ pose, size=size, mesh=body.name, panes=body.panes)
