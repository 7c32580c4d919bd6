"""Poses of actors over the duration of a frame."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from urbantwin.geometry import Pose

__all__ = ["ActorPath", "Paths", "PosedActor"]


class ActorPath(NamedTuple):
    """Sampled poses (``site_SE3_asset``), interpolated between samples and extrapolated beyond.

    Attributes:
        time_s: (T,) float64, seconds relative to the frame's time, ascending; T >= 2.
        rotation: (T, 3, 3) float64.
        translation: (T, 3) float64, metres.
    """

    time_s: NDArray[np.float64]
    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]

    def leg(self, time_s: float) -> tuple[int, float]:
        """Return the index of the sample before a time and the duration of its segment, seconds."""
        k = min(max(bisect_right(self.time_s, time_s) - 1, 0), len(self.time_s) - 2)
        return k, self.time_s[k + 1] - self.time_s[k]

    def at(self, time_s: float) -> Pose:
        """Return the pose at a time: linear in position, constant angular velocity in rotation."""
        k, took_s = self.leg(time_s)
        share = (time_s - self.time_s[k]) / took_s
        a, b = self.rotation[k], self.rotation[k + 1]
        turn = Rotation.from_matrix(a.T @ b).as_rotvec()
        rotation = a @ Rotation.from_rotvec(share * turn).as_matrix()
        step = self.translation[k + 1] - self.translation[k]
        return Pose(rotation, self.translation[k] + share * step)


class PosedActor(NamedTuple):
    """The state of an actor in one frame.

    Attributes:
        track: track id, 1, 2, 3, ..., the same in every frame.
        actor_class: one of ``taxonomy.ACTOR_CLASSES``.
        asset: name of its mesh.
        phase: gait phase of a walking asset, 0 for rigid ones.
        site_SE3_asset: pose at the frame's time.
        velocity: (3,) metres per second, site frame.
        path: poses around the frame's time; ``None``: constant ``velocity``.
        size: length, width and height of its track's box, metres; ``None``: the bounds of its mesh.
        ahead_m: distance of the box's centre ahead of the mesh's origin, metres.
    """

    track: int
    actor_class: str
    asset: str
    phase: int
    site_SE3_asset: Pose  # noqa: N815
    velocity: NDArray[np.float64]
    path: ActorPath | None = None
    size: tuple[float, float, float] | None = None
    ahead_m: float = 0.0

    @property
    def way(self) -> ActorPath:
        """The path; with constant velocity if none is given."""
        if self.path is not None:
            return self.path
        pose = self.site_SE3_asset
        return ActorPath(
            np.array([0.0, 1.0]),
            np.array([pose.rotation, pose.rotation]),
            np.array([pose.translation, pose.translation + self.velocity]),
        )


class Paths(NamedTuple):
    """Paths of the A actors of a frame, padded to the same number T of samples.

    Attributes:
        time_s: (A, T) float64, seconds relative to the frame's time.
        rotation: (A, T, 3, 3) float64, ``site_SE3_asset``.
        translation: (A, T, 3) float64, metres.
        turn: (A, T - 1, 3) float64, rotation vector from each sample to the next, asset frame.
    """

    time_s: NDArray[np.float64]
    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]
    turn: NDArray[np.float64]

    @classmethod
    def of(cls, ways: Sequence[ActorPath]) -> Paths:
        """Stack paths; shorter ones are extrapolated."""
        lengths = {len(way.time_s) for way in ways}
        longest, count = max(lengths, default=2), len(ways)
        if len(lengths) == 1:
            rotation = np.array([way.rotation for way in ways])
            place = np.array([way.translation for way in ways])
            return cls(np.array([way.time_s for way in ways]), rotation, place, _turns(rotation))
        time_s = np.empty((count, longest))
        rotation, place = np.empty((count, longest, 3, 3)), np.empty((count, longest, 3))
        for n, way in enumerate(ways):
            known = len(way.time_s)
            time_s[n, :known] = way.time_s
            rotation[n, :known], place[n, :known] = way.rotation, way.translation
            for k in range(known, longest):
                later = float(way.time_s[-1]) + (k - known + 1)
                pose = way.at(later)
                time_s[n, k], rotation[n, k], place[n, k] = later, pose.rotation, pose.translation
        return cls(time_s, rotation, place, _turns(rotation))

    @classmethod
    def standing(cls) -> Paths:
        """Return the path of the static world: the identity at all times."""
        rotation = np.broadcast_to(np.eye(3), (1, 2, 3, 3)).copy()
        return cls(np.array([[0.0, 1.0]]), rotation, np.zeros((1, 2, 3)), np.zeros((1, 1, 3)))


def _turns(rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rotation vectors (A, T - 1, 3) between consecutive samples."""
    count, knots = rotation.shape[:2]
    step = np.swapaxes(rotation[:, :-1], 2, 3) @ rotation[:, 1:]
    still = (np.abs(step - np.eye(3)) < 1e-15).all(axis=(2, 3))
    turn = np.zeros((count, knots - 1, 3))
    if not still.all():
        turn[~still] = Rotation.from_matrix(step[~still]).as_rotvec()
    return turn
