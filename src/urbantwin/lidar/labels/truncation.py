"""Truncation: the share of an actor outside a sensor's field of view, by ray casting.

Rays are sent at the actor alone, evenly over the solid angle of its bounds, as if the sensor looked
in all directions and to any distance. Of those that hit, the share that a `FieldOfView` does not
hold is the truncation, 0 to 1: KITTI's notion of an object that leaves the image (Geiger et al.
2012, CVPR, "Are we ready for autonomous driving?"), of a sensor's field and span of ranges. An
actor whose bounds are well inside needs no ray.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import Pose
from urbantwin.geometry.rays import RayScene
from urbantwin.lidar.compiled.bounds import bounds_of_box, in_field
from urbantwin.lidar.compiled.pose import poses_at
from urbantwin.lidar.shapes import PresentActors
from urbantwin.lidar.sight.field_of_view import FieldOfView

__all__ = ["Known", "StandingActors", "truncations"]

#: What rays told of an actor that stood so: its truncation, and whether it is too far away.
Known = dict[bytes, tuple[float, bool]]

#: Rays at an actor: a car's share is right to 2 %, a bicycle's, which few of them hit, to 4 %.
_RAYS = 500
#: Where in an actor's bounds they go, 0..1: along a lattice, so that no border runs along a row
#: (the golden ratio's: Niederreiter 1992, "Random Number Generation and Quasi-Monte Carlo
#: Methods", SIAM, section 3).
_ACROSS = (np.arange(_RAYS) + 0.5) / _RAYS
_UP = (np.arange(_RAYS) * (np.sqrt(5) - 1) / 2) % 1.0


class StandingActors(NamedTuple):
    """A actors where they stand in their boxes.

    Attributes:
        low: (A, 3) lower corner of each one's bounds, in its own frame.
        high: (A, 3) upper corner.
        rotation: (A, 3, 3) of ``site_SE3_asset``.
        place: (A, 3) of ``site_SE3_asset``.
        scenes: the triangles of each, in its own frame.
    """

    low: NDArray[np.float64]
    high: NDArray[np.float64]
    rotation: NDArray[np.float64]
    place: NDArray[np.float64]
    scenes: Sequence[RayScene]

    @classmethod
    def at(cls, when_s: NDArray[np.float64], actors: PresentActors) -> StandingActors:
        """Return actors where they stand at times (A,) of their own."""
        rotation, place = poses_at(when_s, actors.paths)
        scenes = [actors.shapes.scenes[number] for number in actors.shape.tolist()]
        return cls(actors.low, actors.high, rotation, place, scenes)


def truncations(
    field: FieldOfView,
    site_SE3_sensor: Pose,
    actors: StandingActors,
    known: Known | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return how much of actors one sensor does not see, whatever stands before them.

    Args:
        field: what the sensor sees.
        site_SE3_sensor: its pose.
        actors: where they stand.
        known: of an earlier frame of the same field; it gets what this one says in its place.
            Who is parked, or waits, is looked at once.

    Returns:
        (A,) truncation, 0..1, and (A,) whether all of it is farther than the sensor measures.
    """
    if not len(actors.place):
        return np.zeros(0), np.zeros(0, np.bool_)
    rotation, origin = site_SE3_sensor.rotation, site_SE3_sensor.translation
    whole, beyond = in_field(
        actors.low,
        actors.high,
        actors.rotation,
        actors.place,
        np.array(rotation[None], order="C"),
        np.array(origin[None]),
        field.all_around,
        field.range_m,
    )
    found = np.where(beyond, 1.0, 0.0)
    known = {} if known is None else known
    before = dict(known)
    known.clear()
    for number in np.flatnonzero(~whole & ~beyond).tolist():
        own, low, high = actors.rotation[number], actors.low[number], actors.high[number]
        asset_R_sensor = np.ascontiguousarray(own.T @ rotation)
        eye = (origin - actors.place[number]) @ own
        key = asset_R_sensor.tobytes() + eye.tobytes() + id(actors.scenes[number]).to_bytes(8)
        if key in before:
            known[key] = found[number], beyond[number] = before[key]
            continue
        aims = _aims(bounds_of_box(low, high, asset_R_sensor, eye))
        local = (aims @ asset_R_sensor.T).astype(np.float32)
        hits = actors.scenes[number].cast(eye, local)
        hit = np.flatnonzero(hits.face >= 0)
        aims, range_m = aims[hit], hits.range_m[hit].astype(np.float64)
        if not len(hit):  # Thinner than the rays are apart: its middle decides.
            middle = ((low + high) / 2 - eye) @ asset_R_sensor
            range_m = np.linalg.norm(middle[None], axis=1)
            aims = middle[None] / np.maximum(range_m, 1e-9)
        found[number] = 1.0 - field.sees(aims, range_m).mean()
        beyond[number] = bool((range_m > field.range_m[1]).all())
        known[key] = float(found[number]), bool(beyond[number])
    return found, beyond


def _aims(bounds: tuple[float, float, float, float]) -> NDArray[np.float64]:
    """Return unit vectors (N, 3) evenly over the solid angle of bounds, sensor frame.

    Bounds are azimuth, width, lowest and highest elevation, radians.
    """
    azimuth, width, lowest, highest = bounds
    turn = azimuth + _ACROSS * width
    up = np.sin(lowest) + _UP * (np.sin(highest) - np.sin(lowest))
    flat = np.sqrt(np.maximum(0.0, 1.0 - up**2))
    return np.stack([flat * np.cos(turn), flat * np.sin(turn), up], axis=-1)
