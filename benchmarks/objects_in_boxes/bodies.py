"""Our bodies in real boxes: which of the catalogue, in which pose and size."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import LabelledMesh, Pose
from urbantwin.geometry.rays import RayScene
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

__all__ = ["PlacedBody", "candidates", "placed"]

#: Points lower than this over a box's underside may be of the ground, metres.
GROUND_M = 0.25
#: So many bodies and postures are tried: those of wheels alone have no postures.
_TRIED, _TRIED_POSED = 8, 30
#: How many postures of a cycle are tried, beside that of who halts.
_POSTURES = 6
#: What data sets call a truck may be a large van: its bodies are tried too.
_ALSO = {"truck": ("van",)}
#: Who pushes or sits is rare: tried only where the data calls it so.
_CALLED = {
    "pedestrian-stroller": ("stroller",),
    "pedestrian-wheelchair": ("wheelchair", "wheeled", "sitting"),
}
#: Points that far outside of an annotated box are still its object's, metres.
AROUND_M = 0.15
#: Two-wheelers that nobody rides, as data sets call them.
_PARKED = ("bicycle", "motorcycle", "bike", "vehicle.bicycle", "vehicle.motorcycle")
_RIDER = ("cloth", "skin")
#: From where it is looked whether a face is seen: elevations, so many headings, so far off it.
_UP_DEG, _AROUND, _OFF_M = (5.0, 30.0, 60.0), 12, 2e-3


@dataclass(frozen=True, eq=False)
class PlacedBody:
    """A body in a box.

    Attributes:
        asset: name of the body, with its coat.
        box: (7,) that it fills: centre, length, width, height, yaw.
        mesh: in its own frame: x ahead, z up from the ground.
        outer: (F,) whether a face is seen from outside: not what stands behind panes.
        disproportion: how far its own sides are off those of the box as annotated, sum of the
            logarithms.
    """

    asset: str
    box: NDArray[np.float64]
    mesh: LabelledMesh
    outer: NDArray[np.bool_]
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
    posed = any(phase != asset(name).standing for name, phase in extents)
    count = most or (_TRIED_POSED if posed else _TRIED)
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
            coated = coated_name(name, number, asset(name).actor_class)
            mesh = coated_mesh(mesh, AssetName.of(coated).coat)
        filling = scaled_mesh(mesh, (float(x), float(y), float(z)))
        outer = _outer(name, phase, riderless)
        found.append(PlacedBody(coated, filled, filling, outer, off[name, phase]))
    return found


@cache
def _extents(class_name: str, riderless: bool) -> dict[tuple[str, int], NDArray[np.float64]]:
    """Return the size (3,) of each body of a class in each posture."""
    found = {}
    for name in (
        one for kind in (class_name, *_ALSO.get(class_name, ())) for one in asset_names(kind)
    ):
        entry = asset(name)
        phases = {entry.standing}
        if entry.phases > 1 and not riderless:
            phases |= set(range(0, entry.phases, max(1, entry.phases // _POSTURES)))
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


@cache
def _outer(name: str, phase: int, riderless: bool) -> NDArray[np.bool_]:
    """Return which faces (F,) of a body something around it sees, panes shut."""
    mesh = _stood(name, phase, riderless)
    scene = RayScene(mesh.vertices, mesh.faces)
    middle, normal = mesh.triangles().mean(axis=1), mesh.normals()
    seen = np.zeros(len(mesh.faces), np.bool_)
    for up in np.radians(_UP_DEG):
        for turn in np.linspace(0, 2 * np.pi, _AROUND, endpoint=False):
            aim = np.array([np.cos(up) * np.cos(turn), np.cos(up) * np.sin(turn), np.sin(up)])
            # Of thin sheets both sides are faces: the one turned away is behind the other.
            side = np.sign(normal @ aim)[:, None]
            rows = np.flatnonzero(~seen)
            start = middle[rows] + _OFF_M * side[rows] * normal[rows]
            aims = np.broadcast_to(aim, start.shape).astype(np.float32)
            seen[rows] = ~np.isfinite(scene.cast(start, aims).range_m)
    return seen
