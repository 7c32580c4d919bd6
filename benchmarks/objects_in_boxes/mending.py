"""Boxes mended: bodies moved and stretched to what a frame says of their object.

Points say where a body's surface is; rays that passed by and ended behind say where it is not. So
a box that annotators drew with slack shrinks to what is in it, a roof too that hardly a point lies
on.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from objects_in_boxes.bodies import GROUND_M, PlacedBody
from urbantwin.fidelity.nearest_triangle import NearestTriangle
from urbantwin.geometry import LabelledMesh
from urbantwin.geometry.rays import RayScene
from urbantwin.traffic.assets import scaled_mesh

__all__ = ["PassedBy", "mended", "mended_of"]

#: Standard deviations by which annotators are off: ahead, to the left (metres), heading (radians),
#: and the logarithms of length, width and height.
_TRUST = np.array([0.25, 0.15, 0.03, 0.08, 0.08, 0.07])
#: How exactly a point lies on a body, metres; from how far on it counts less and less.
_POINT_M, _OTHER_M = 0.05, 0.1
#: So are at first farther points, so that a box that is far off is found at all.
_GRADUATED_M = (0.6, _OTHER_M)
#: By how much, as the sum of the logarithms of three sides, another body's proportions are off.
_PROPORTIONS = 0.25
#: A box with fewer points stays as it was annotated; of more than so many points, and rays that
#: passed by, these are looked at.
_FEWEST, _MOST = 15, 250
#: Points say together as much as so many that are independent; nobody is off by more than so many
#: standard deviations.
_WORTH, _FARTHEST = 40, 2.5
#: How far around a box a ray passes by, metres, and how far behind it it ends at least.
_NEAR_M, _BEHIND_M = 0.2, 0.5
#: Where between entering and leaving a body it is asked how deep a ray is in it.
_ALONG = (0.25, 0.5, 0.75)


@dataclass(frozen=True, eq=False)
class PassedBy:
    """The R rays that went through a box, or close by, and ended behind it.

    Attributes:
        start: (R, 3) a point of each before the box, frame of the box.
        stop: (R, 3) a point of each behind it.
    """

    start: NDArray[np.float64]
    stop: NDArray[np.float64]

    @classmethod
    def none(cls) -> PassedBy:
        """Return that none is known."""
        return cls(np.zeros((0, 3)), np.zeros((0, 3)))

    @classmethod
    def of(
        cls,
        box: NDArray[np.float64],
        origin: NDArray[np.float64],
        direction: NDArray[np.float64],
        range_m: NDArray[np.float64],
    ) -> PassedBy:
        """Return those of R rays from one place that passed by a box (7,).

        Args:
            box: centre, length, width, height, yaw.
            origin: (3,) where they leave.
            direction: (R, 3) unit vectors.
            range_m: (R,) where they ended; inf where nothing came back: those say nothing.
        """
        cos, sin = np.cos(box[6]), np.sin(box[6])
        turned = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
        away, aim = turned @ (origin - box[:3]), direction @ turned.T
        half = box[3:6] / 2 + _NEAR_M
        with np.errstate(divide="ignore", invalid="ignore"):
            low, high = (-half - away) / aim, (half - away) / aim
        enters = np.nanmax(np.minimum(low, high), axis=1)
        leaves = np.nanmin(np.maximum(low, high), axis=1)
        passed = (leaves > np.maximum(enters, 0.0)) & np.isfinite(range_m)
        chosen = np.flatnonzero(passed & (range_m > leaves + _BEHIND_M))
        aims = direction[chosen]
        first = np.maximum(enters[chosen], 0.0)
        return cls(origin + aims * first[:, None], origin + aims * leaves[chosen, None])

    def joined(self, other: PassedBy) -> PassedBy:
        """Return these and those of another sensor."""
        return PassedBy(
            np.concatenate([self.start, other.start]), np.concatenate([self.stop, other.stop])
        )


def mended_of(
    bodies: list[PlacedBody], points: NDArray[np.float64], passed: PassedBy | None = None
) -> PlacedBody:
    """Mend bodies to what is known of an object and return the one that then fits best.

    A box says neither which body it holds nor in which posture. How far its proportions are off
    counts as the box's own changes do.

    Args:
        bodies: in the box as annotated, the nearest first (`bodies.candidates`).
        points: (N, 3) of the object, frame of the box.
        passed: rays that passed by it.
    """
    tried = [_mend(body, points, passed or PassedBy.none()) for body in bodies]
    misfit = [
        cost + ((body.disproportion - bodies[0].disproportion) / _PROPORTIONS) ** 2
        for (_, cost), body in zip(tried, bodies, strict=True)
    ]
    return tried[int(np.argmin(misfit))][0]


def mended(
    body: PlacedBody, points: NDArray[np.float64], passed: PassedBy | None = None
) -> PlacedBody:
    """Move and stretch a body to what is known of its object, as far as annotators are off.

    Least squares of the distances of points to the body's surface, of how deep in it rays would be
    that passed by, and of what is changed by what annotators are known to be off; it stands where
    it stood. Sides that neither say anything of stay.

    Args:
        body: in its box as annotated.
        points: (N, 3) of the object, frame of the box.
        passed: rays that passed by it.
    """
    return _mend(body, points, passed or PassedBy.none())[0]


def _mend(
    body: PlacedBody, points: NDArray[np.float64], passed: PassedBy
) -> tuple[PlacedBody, float]:
    """Return a body mended, and what is left: the sum of squares."""
    inverse = body.pose.inverse()
    local = inverse.apply(points)
    local = local[local[:, 2] > GROUND_M]
    if len(local) < _FEWEST:
        return body, 0.0
    thinned = local[:: -(-len(local) // _MOST)]
    # What stands behind panes holds points too, but a box is not to be drawn to them.
    shell = body.mesh.select(body.outer)
    inside = _Inside(shell)
    worth = np.sqrt(min(len(local), _WORTH) / len(local)) / _POINT_M
    share = worth * np.sqrt(len(local) / len(thinned))
    start, stop = inverse.apply(passed.start), inverse.apply(passed.stop)
    # What passes low may pass below it.
    above = np.maximum(start[:, 2], stop[:, 2]) > GROUND_M
    start, stop = start[above], stop[above]
    step = max(1, -(-len(start) // _MOST))
    start, stop = start[::step], stop[::step]
    of_rays = worth * np.sqrt(step)

    def off(place: NDArray[np.float64], other: float) -> NDArray[np.float64]:
        change = place - 1.0
        distance = inside.surface.distances(_into(thinned, change * _TRUST)) * share
        # Points of something else pull no harder the farther they are.
        distance = _tempered(distance, other * share)
        deep = inside.depth(_into(start, change * _TRUST), _into(stop, change * _TRUST))
        return np.concatenate([distance, _tempered(deep * of_rays, other * of_rays), change])

    # Steps of differences are relative to the start, which so is 1.
    low, high = 1 - _FARTHEST, 1 + _FARTHEST
    place, cost = np.ones(6), 0.0
    for other in _GRADUATED_M:
        begin = np.clip(place, low + 1e-6, high - 1e-6)
        solved = least_squares(
            off, begin, bounds=(low, high), diff_step=0.05, xtol=1e-3, ftol=1e-3, args=(other,)
        )
        place, cost = solved.x, 2 * float(solved.cost)
    found = (place - 1.0) * _TRUST
    ahead, left, turn = found[:3]
    box = body.box.copy()
    cos, sin = np.cos(box[6]), np.sin(box[6])
    box[0] += cos * ahead - sin * left
    box[1] += sin * ahead + cos * left
    box[6] += turn
    factors = np.exp(found[3:])
    box[2] += box[5] * (factors[2] - 1) / 2
    box[3:6] *= factors
    x, y, z = (float(one) for one in factors)
    return PlacedBody(body.asset, box, scaled_mesh(body.mesh, (x, y, z)), body.outer), cost


def _tempered(off: NDArray[np.float64], other: float) -> NDArray[np.float64]:
    """Return what is off with less and less weight beyond ``other``."""
    return np.asarray(np.sqrt(np.log1p((off / other) ** 2)) * other)


def _into(points: NDArray[np.float64], change: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points (N, 3) as they lie to the body before it was changed."""
    cos, sin = np.cos(change[2]), np.sin(change[2])
    x, y = points[:, 0] - change[0], points[:, 1] - change[1]
    turned = np.column_stack([cos * x + sin * y, cos * y - sin * x, points[:, 2]])
    return np.asarray(turned / np.exp(change[3:]))


class _Inside:
    """How deep rays are in a body. Hardly a ray ends behind two panes: they count as shut.

    Args:
        shell: its outer surface.
    """

    def __init__(self, shell: LabelledMesh) -> None:
        self._scene = RayScene(shell.vertices, shell.faces)
        self.surface = NearestTriangle(shell.vertices, shell.faces.astype(np.int64))

    def depth(self, start: NDArray[np.float64], stop: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how far (R,) from the surface rays get between entering it and leaving, metres."""
        found = np.zeros(len(start))
        if not len(start):
            return found
        length = np.linalg.norm(stop - start, axis=1)
        aim = (stop - start) / np.maximum(length, 1e-9)[:, None]
        enters = self._scene.cast(start, aim.astype(np.float32)).range_m.astype(np.float64)
        met = np.flatnonzero(enters < length)
        back = self._scene.cast(stop[met], -aim[met].astype(np.float32))
        leaves = length[met] - back.range_m
        for part in _ALONG:
            at = enters[met] + part * np.maximum(leaves - enters[met], 0.0)
            places = start[met] + at[:, None] * aim[met]
            found[met] = np.maximum(found[met], self.surface.distances(places))
        return found
