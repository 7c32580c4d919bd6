"""Casting at moving actors: only the rays that can touch one, in its own frame.

An actor's mesh never changes shape, so its ray tracing structure is built once per asset and
gait phase, and rays are brought into the actor's frame instead. All rays of a frame are fired at
the frame's time: this version has no rolling shutter.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from urbantwin.geometry import LabelledMesh, Pose
from urbantwin.lidar.casting import EmbreeCaster
from urbantwin.lidar.rectangle import Rays, angular_bounds
from urbantwin.lidar.returns import scatter_of_materials

__all__ = ["ActorHits", "ActorShape", "MeshSource", "cast_actors", "nearest"]

#: Gives the mesh of an asset in a gait phase, in the asset's frame.
MeshSource = Callable[[str, int], LabelledMesh]

_CORNERS = (np.arange(8)[:, None] >> np.arange(3) & 1).astype(np.float64)


class ActorShape:
    """An asset's mesh, made ready for rays. All in the asset's frame, metres.

    Attributes:
        caster: its ray tracing structure.
        low: (3,) lower corner of its bounds.
        high: (3,) upper corner of its bounds.
        hull: (3, H) vertices of its convex hull: the only ones that can touch a bound of the
            mesh, however it is turned.
    """

    def __init__(self, mesh: LabelledMesh) -> None:
        used = mesh.vertices[np.unique(mesh.faces)]
        self.caster = EmbreeCaster(mesh.vertices, mesh.faces)
        self.low, self.high = used.min(axis=0), used.max(axis=0)
        with suppress(QhullError):  # A flat mesh has no volume.
            used = used[ConvexHull(used).vertices]
        self.hull = np.ascontiguousarray(used.T)
        self._normals, self._material = mesh.normals(), mesh.material
        self._facing: dict[float, NDArray[np.float32]] = {}

    def facing(self, wavelength_nm: float) -> NDArray[np.float32]:
        """Return unit normals times backscatter (F, 3) at a wavelength.

        Their dot product with a ray's direction is, but for the sign, the ray's backscatter.
        Nothing on an actor has glass beads.
        """
        if wavelength_nm not in self._facing:
            diffuse = scatter_of_materials(wavelength_nm).diffuse[self._material]
            self._facing[wavelength_nm] = (self._normals * diffuse[:, None]).astype(np.float32)
        return self._facing[wavelength_nm]


@dataclass(frozen=True, eq=False)
class ActorHits:
    """Rays that hit actors, as if each actor were alone: a ray may appear once per actor.

    Attributes:
        ray: (M,) int64, ring * columns + column.
        actor: (M,) int64, which actor of the given sequence.
        range_m: (M,) float32.
        backscatter: (M,) float32, see ``returns``.
    """

    ray: NDArray[np.int64]
    actor: NDArray[np.int64]
    range_m: NDArray[np.float32]
    backscatter: NDArray[np.float32]

    @classmethod
    def none(cls) -> ActorHits:
        """Return no hits."""
        whole, real = np.zeros(0, np.int64), np.zeros(0, np.float32)
        return cls(whole, whole, real, real)

    @classmethod
    def joined(cls, parts: Sequence[ActorHits]) -> ActorHits:
        """Return the hits of all parts, in their order."""
        return cls(
            np.concatenate([part.ray for part in parts]),
            np.concatenate([part.actor for part in parts]),
            np.concatenate([part.range_m for part in parts]),
            np.concatenate([part.backscatter for part in parts]),
        )


def cast_actors(
    grid: Rays,
    directions: NDArray[np.float32],
    site_SE3_sensor: Pose,
    range_max_m: float,
    actors: Sequence[tuple[ActorShape, Pose]],
    wavelength_nm: float = 905.0,
) -> ActorHits:
    """Cast at every actor the rays that can touch it.

    Args:
        grid: the sensor's rays by where they point.
        directions: (N, 3) unit vectors of its rays, site frame.
        site_SE3_sensor: the sensor's pose.
        range_max_m: an actor wholly beyond it is left out.
        actors: shape and pose (``site_SE3_asset``) of each.
        wavelength_nm: of the sensor's laser.
    """
    if not actors:
        return ActorHits.none()
    low = np.array([shape.low for shape, _ in actors])
    high = np.array([shape.high for shape, _ in actors])
    site_R_asset = np.array([pose.rotation for _, pose in actors])
    offset = np.array([pose.translation for _, pose in actors]) - site_SE3_sensor.translation
    origin = -np.einsum("ai,aij->aj", offset, site_R_asset)
    near = np.linalg.norm(origin - np.clip(origin, low, high), axis=1) <= range_max_m

    corners = low[:, None] + _CORNERS * (high - low)[:, None]
    in_sensor = (corners @ site_R_asset.transpose(0, 2, 1) + offset[:, None]) @ (
        site_SE3_sensor.rotation
    )
    bounds = angular_bounds(in_sensor)
    turns = site_R_asset.astype(np.float32)
    parts = [ActorHits.none()]
    for number in np.flatnonzero(near).tolist():
        shape, _ = actors[number]
        ray = grid.rays_within(
            bounds.azimuth[number],
            bounds.width[number],
            bounds.lowest[number],
            bounds.highest[number],
        )
        local = directions.take(ray, axis=0) @ turns[number]
        found = shape.caster.cast(origin[number], local)
        hit = np.flatnonzero(found.face >= 0)
        facing = shape.facing(wavelength_nm).take(found.face.take(hit), axis=0)
        backscatter = np.abs(np.einsum("ij,ij->i", facing, local.take(hit, axis=0)))
        owner = np.full(len(hit), number)
        parts.append(ActorHits(ray.take(hit), owner, found.range_m.take(hit), backscatter))
    return ActorHits.joined(parts)


def nearest(hits: ActorHits, static_range_m: NDArray[np.float32]) -> NDArray[np.int64]:
    """Return which hits (numbers into M) come first along their rays.

    Against the static world and among each other. At the same range an actor is seen before the
    static world, and of two actors the one that was given first.

    Args:
        hits: hits of every actor alone.
        static_range_m: (N,) range of the static world along every ray.
    """
    depth = static_range_m.copy()
    np.minimum.at(depth, hits.ray, hits.range_m)
    front = np.flatnonzero(hits.range_m == depth.take(hits.ray))
    # Backwards, so that the first of several equals stands in the end.
    winner = np.empty(len(depth), np.int64)
    winner[hits.ray[front[::-1]]] = front[::-1]
    return np.asarray(front[winner[hits.ray[front]] == front])
