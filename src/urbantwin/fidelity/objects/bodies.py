"""Our bodies in real boxes: which of the catalogue, in which pose and size."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from urbantwin.fidelity.nearest_triangle import NearestTriangle
from urbantwin.geometry import LabelledMesh, Pose
from urbantwin.taxonomy import material_id
from urbantwin.traffic.assets import (
    COATED_CLASSES,
    AssetName,
    asset,
    asset_mesh,
    asset_names,
    coated_mesh,
    coated_name,
    scaled_mesh,
)

__all__ = ["PlacedBody", "candidates", "mended", "mended_of", "placed"]

#: Points lower than this over a box's underside may be of the ground, metres.
GROUND_M = 0.25
#: Standard deviations by which annotators are off: ahead, to the left (metres), heading (radians),
#: and the logarithms of length, width and height.
_TRUST = np.array([0.15, 0.1, 0.03, 0.07, 0.06, 0.06])
#: How exactly a point lies on a body, metres; from how far on it counts less and less.
_POINT_M, _OTHER_M = 0.05, 0.1
#: So are at first farther points, so that a box that is far off is found at all.
_GRADUATED_M = (0.3, _OTHER_M)
#: So many bodies and postures are tried, and by how much, as the sum of the logarithms of three
#: sides, another body's proportions are off.
_TRIED, _TRIED_PEOPLE, _PROPORTIONS = 4, 10, 0.25
#: Who pushes or sits is rare: tried only where the data calls it so.
_CALLED = {
    "pedestrian-stroller": ("stroller",),
    "pedestrian-wheelchair": ("wheelchair", "wheeled", "sitting"),
}
#: A box with fewer points stays as it was annotated; of more than so many these are looked at.
_FEWEST, _MOST = 15, 250
#: Points say together as much as so many that are independent; nobody is off by more than so many
#: standard deviations.
_WORTH, _FARTHEST = 40, 2.5
#: Points that far outside of an annotated box are still its object's, metres.
AROUND_M = 0.15
#: Two-wheelers that nobody rides, as data sets call them.
_PARKED = ("bicycle", "motorcycle", "bike", "vehicle.bicycle", "vehicle.motorcycle")
_RIDER = ("cloth", "skin")


@dataclass(frozen=True, eq=False)
class PlacedBody:
    """A body in a box.

    Attributes:
        asset: name of the body, with its coat.
        box: (7,) that it fills: centre, length, width, height, yaw.
        mesh: in its own frame: x ahead, z up from the ground.
        disproportion: how far its own sides are off those of the box as annotated, sum of the
            logarithms.
    """

    asset: str
    box: NDArray[np.float64]
    mesh: LabelledMesh
    disproportion: float = 0.0

    @property
    def pose(self) -> Pose:
        """Where it stands, frame of the box."""
        under = self.box[:3] - [0, 0, self.box[5] / 2]
        return Pose.from_ypr(under, float(self.box[6]))


def placed(class_name: str, box: NDArray[np.float64], number: int, source: str = "") -> PlacedBody:
    """Put the body of a class whose proportions come nearest into a box, and make it fill it.

    See `candidates` for what it takes.
    """
    return candidates(class_name, box, number, source, most=1)[0]


def candidates(
    class_name: str,
    box: NDArray[np.float64],
    number: int,
    source: str = "",
    most: int | None = None,
) -> list[PlacedBody]:
    """Put the bodies of a class whose proportions come nearest into a box and make them fill it.

    Args:
        class_name: one of ``taxonomy.ACTOR_CLASSES``.
        box: (7,) to fill.
        number: of the object: its coat is drawn by it, as those of traffic are.
        source: what the data calls it: a bicycle that nobody rides goes without a rider.
        most: so many; as many as are worth trying if not given.

    Returns:
        Bodies, of people in several postures, the nearest first.
    """
    size, called = box[3:6], source.lower()
    riderless = class_name in ("bicycle", "motorcycle") and called in _PARKED
    extents = {
        one: extent
        for one, extent in _extents(class_name, riderless).items()
        if one[0] not in _CALLED or any(word in called for word in _CALLED[one[0]])
    }
    off = {one: float(np.abs(np.log(size / extents[one])).sum()) for one in extents}
    count = most or (_TRIED_PEOPLE if class_name == "pedestrian" else _TRIED)
    found = []
    for name, phase in sorted(extents, key=lambda one: (off[one], one))[:count]:
        mesh = _stood(name, phase, riderless)
        factors, filled = size / extents[name, phase], box
        if class_name == "pedestrian":
            # Posture and slack make the plan of a box; nobody's head is wider for it.
            factors = np.full(3, factors[2])
            filled = np.concatenate([box[:3], factors * extents[name, phase], box[6:]])
        x, y, z = factors
        coated = name
        if class_name in COATED_CLASSES:
            coated = coated_name(name, number, class_name)
            mesh = coated_mesh(mesh, AssetName.of(coated).coat)
        filling = scaled_mesh(mesh, (float(x), float(y), float(z)))
        found.append(PlacedBody(coated, filled, filling, off[name, phase]))
    return found


def mended_of(bodies: list[PlacedBody], points: NDArray[np.float64]) -> PlacedBody:
    """Mend bodies to the points of an object and return the one that then fits best.

    A box says neither which body it holds nor in which posture. How far its proportions are off
    counts as the box's own changes do.

    Args:
        bodies: in the box as annotated, the nearest first (`candidates`).
        points: (N, 3) of the object, frame of the box.
    """
    tried = [_mend(body, points) for body in bodies]
    misfit = [
        cost + ((body.disproportion - bodies[0].disproportion) / _PROPORTIONS) ** 2
        for (_, cost), body in zip(tried, bodies, strict=True)
    ]
    return tried[int(np.argmin(misfit))][0]


def mended(body: PlacedBody, points: NDArray[np.float64]) -> PlacedBody:
    """Move and stretch a body to the points of its object, as far as annotators are off.

    Least squares of the distances of points to the body's surface and of what is changed by what
    annotators are known to be off; it stands where it stood. Unseen sides stay.

    Args:
        body: in its box as annotated.
        points: (N, 3) of the object, frame of the box.
    """
    return _mend(body, points)[0]


def _mend(body: PlacedBody, points: NDArray[np.float64]) -> tuple[PlacedBody, float]:
    """Return a body mended to points, and what is left: the sum of squares."""
    local = body.pose.inverse().apply(points)
    local = local[local[:, 2] > GROUND_M]
    if len(local) < _FEWEST:
        return body, 0.0
    local = local[:: -(-len(local) // _MOST)]
    surface = NearestTriangle(body.mesh.vertices, body.mesh.faces.astype(np.int64))
    share = np.sqrt(min(len(local), _WORTH) / len(local)) / _POINT_M

    def off(place: NDArray[np.float64], other: float) -> NDArray[np.float64]:
        change = place - 1.0
        back = _into(local, change * _TRUST)
        distance = surface.distances(back) * share
        # Points of something else pull no harder the farther they are.
        distance = np.sqrt(np.log1p((distance / share / other) ** 2)) * other * share
        return np.concatenate([distance, change])

    # Steps of differences are relative to the start, which so is 1.
    low, high = 1 - _FARTHEST, 1 + _FARTHEST
    place, cost = np.ones(6), 0.0
    for other in _GRADUATED_M:
        start = np.clip(place, low + 1e-6, high - 1e-6)
        solved = least_squares(
            off, start, bounds=(low, high), diff_step=0.05, xtol=1e-3, ftol=1e-3, args=(other,)
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
    return PlacedBody(body.asset, box, scaled_mesh(body.mesh, (x, y, z))), cost


def _into(points: NDArray[np.float64], change: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points (N, 3) as they lie to the body before it was changed."""
    cos, sin = np.cos(change[2]), np.sin(change[2])
    x, y = points[:, 0] - change[0], points[:, 1] - change[1]
    turned = np.column_stack([cos * x + sin * y, cos * y - sin * x, points[:, 2]])
    return np.asarray(turned / np.exp(change[3:]))


@cache
def _extents(class_name: str, riderless: bool) -> dict[tuple[str, int], NDArray[np.float64]]:
    """Return the size (3,) of each body of a class in each posture."""
    found = {}
    for name in asset_names(class_name):
        entry = asset(name)
        phases = {entry.standing}
        if class_name == "pedestrian":
            phases |= set(range(0, entry.phases, max(1, entry.phases // 4)))
        for phase in sorted(phases):
            mesh = _stood(name, phase, riderless)
            found[name, phase] = np.asarray(np.ptp(mesh.vertices, axis=0))
    return found


@cache
def _stood(name: str, phase: int, riderless: bool) -> LabelledMesh:
    """Return a body over the middle of its bounds, on the ground."""
    mesh = asset_mesh(name, phase)
    if riderless:
        rider = np.isin(mesh.material, [material_id(one) for one in _RIDER])
        mesh = mesh.select(~np.isin(mesh.part, np.unique(mesh.part[rider])))
    mesh = mesh.select(np.ones(len(mesh.faces), np.bool_))
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    middle = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    moved = mesh.vertices - middle
    return LabelledMesh(moved, mesh.faces, mesh.semantic, mesh.material, mesh.part)
