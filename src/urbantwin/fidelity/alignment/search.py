"""Searching a sensor's place and heading: which of many makes its points lie on the scene."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from urbantwin.fidelity.alignment.ground_plane import GroundPlane, leveling, thinned
from urbantwin.fidelity.alignment.scene_points import ScenePoints
from urbantwin.geometry import Pose

__all__ = ["Found", "PoseSearch", "SearchSpan"]

#: Cells of the field of distances: no more than this, and no finer.
_MOST_CELLS, _FINEST_M = 6_000_000, 0.25
#: A point this far from every surface tells nothing more, metres.
_FAR_M = 1.0
#: Of the ground, points count less: it looks alike everywhere.
_GROUND_WEIGHT = 0.2
_MOST_POINTS = 1500
#: Of many poses, every so many points look first.
_MANY_POSES, _FIRST_LOOK = 5000, 6
#: Poses nearer to each other than this are one.
_SAME_M, _SAME_RAD = 1.5, np.radians(8.0)


@dataclass(frozen=True, eq=False)
class SearchSpan:
    """Where the sensor may be.

    Attributes:
        middle: (2,) east and north, metres.
        reach_m: how far from there, east and north.
        yaw: middle heading of the frame's x axis, radians counter-clockwise from east.
        reach_rad: how far from it, either way; pi: any.
    """

    middle: NDArray[np.float64]
    reach_m: float
    yaw: float
    reach_rad: float


@dataclass(frozen=True, eq=False)
class Found:
    """A pose of the sensor and how well it fits.

    Attributes:
        pose: ``site_SE3_frame``.
        score: 0 to 1, the share of what the points could explain.
        yaw: its heading, radians.
    """

    pose: Pose
    score: float
    yaw: float


class PoseSearch:
    """Tries poses at which the sensor stands on the twin's ground as it does on its own.

    Args:
        scene: the static world as points.
        points: (N, 3) of one frame.
        plane: the ground in that frame.
    """

    def __init__(self, scene: ScenePoints, points: NDArray[np.float64], plane: GroundPlane) -> None:
        self._scene, self._plane = scene, plane
        self._level = leveling(plane.normal)
        low = scene.points.min(axis=0) - 2.0
        extent = scene.points.max(axis=0) + 2.0 - low
        self._cell = max(_FINEST_M, float((extent.prod() / _MOST_CELLS) ** (1 / 3)))
        shape = np.ceil(extent / self._cell).astype(int) + 1
        free = np.ones(shape, np.bool_)
        free[tuple(((scene.points - low) / self._cell).astype(int).T)] = False
        away = distance_transform_edt(free, sampling=self._cell)
        self._gain = np.maximum(0.0, 1.0 - away / _FAR_M).astype(np.float32)
        self._low = low
        self._points, self._weight = self._chosen(points)

    def _chosen(
        self, points: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return points in the level frame, on the ground below its origin, and their weights."""
        level = thinned(points, 0.5) @ self._level.T
        generator = np.random.default_rng(len(level))
        above = level[:, 2] + self._plane.height_m
        parts = [np.flatnonzero(above < 0.3), np.flatnonzero((above >= 0.3) & (above < 25.0))]
        kept = [
            generator.permutation(part)[: _MOST_POINTS // (2 - n)] for n, part in enumerate(parts)
        ]
        weight = np.concatenate(
            [
                np.full(len(kept[0]), _GROUND_WEIGHT / max(len(kept[0]), 1)),
                np.full(len(kept[1]), (1 - _GROUND_WEIGHT) / max(len(kept[1]), 1)),
            ]
        )
        return level[np.concatenate(kept)], weight / max(weight.sum(), 1e-9)

    def run(self, span: SearchSpan, most: int = 5) -> list[Found]:
        """Return the best poses, best first; empty where no ground was found in the span."""
        step = float(np.clip(span.reach_m / 6, 0.5, 2.0))
        turn = np.radians(1.5 if span.reach_rad < 0.5 else 4.0)
        offsets = np.arange(-np.floor(span.reach_m / step), span.reach_m / step + 0.5) * step
        xy = np.stack(np.meshgrid(*(span.middle[:, None] + offsets)), -1).reshape(-1, 2)
        yaws = self._yaws(span, turn)
        many = len(xy) * len(yaws) > _MANY_POSES
        found = self._best(xy, yaws, 8 * most, _FIRST_LOOK if many else 1)
        while step > 0.2:
            step, turn = step / 2, turn / 2
            near = np.stack(np.meshgrid([-step, 0, step], [-step, 0, step]), -1).reshape(-1, 2)
            refined = []
            for one in found:
                xy = one.pose.translation[:2] + near
                refined += self._best(xy, one.yaw + np.array([-turn, 0.0, turn]), 1, 1)
            found = _distinct(refined, 2 * most)
        return found[:most]

    @staticmethod
    def _yaws(span: SearchSpan, turn: float) -> NDArray[np.float64]:
        if span.reach_rad >= np.pi:
            count = int(np.ceil(2 * np.pi / turn))
            return span.yaw + 2 * np.pi * np.arange(count) / count
        steps = int(np.ceil(span.reach_rad / turn))
        return np.asarray(span.yaw + np.arange(-steps, steps + 1) * turn)

    def standing(self, xy: NDArray[np.float64], yaw: float) -> Pose:
        """Return the pose of the frame at a place (2,) with a heading."""
        up, place = self._stands(xy[None])
        return self._pose(up[0], place[0], yaw)

    def _pose(self, up: NDArray[np.float64], place: NDArray[np.float64], yaw: float) -> Pose:
        turned = leveling(up).T @ Pose.from_ypr(np.zeros(3), yaw).rotation @ self._level
        return Pose(turned, place)

    def _stands(self, xy: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the ground's normals (P, 3) around places (P, 2), and the frame's origins."""
        around = np.array([[8.0 * np.cos(a), 8.0 * np.sin(a)] for a in np.arange(8) * np.pi / 4])
        heights = self._scene.ground_at((xy[:, None] + around).reshape(-1, 2)).reshape(-1, 8)
        middle = self._scene.ground_at(xy)
        known = np.isfinite(heights)
        rise = np.where(known, heights - middle[:, None], 0.0)
        count = np.maximum(known.sum(axis=1), 1)[:, None]
        slope = 2.0 * (rise @ around) / 64.0 / count
        slope[known.sum(axis=1) < 8] = 0.0
        up = np.column_stack([-slope, np.ones(len(xy))])
        up /= np.linalg.norm(up, axis=1)[:, None]
        ground = np.column_stack([xy, middle])
        return up, ground + self._plane.height_m * np.array([0.0, 0.0, 1.0])

    def _best(
        self, xy: NDArray[np.float64], yaws: NDArray[np.float64], most: int, every: int
    ) -> list[Found]:
        up, place = self._stands(xy)
        there = np.isfinite(place[:, 2])
        up, place = up[there], place[there]
        if not len(place):
            return []
        turned = np.stack([leveling(one).T for one in up])
        headings = np.stack([Pose.from_ypr(np.zeros(3), yaw).rotation for yaw in yaws])
        scores = _scores(
            self._points[::every],
            self._weight[::every] * every,
            turned,
            place - self._low,
            headings,
            self._gain,
            1.0 / self._cell,
        )
        order = np.argsort(-scores, axis=None, kind="stable")[: 50 * most]
        ranked = []
        for n in order:
            k, m = np.unravel_index(n, scores.shape)
            pose = self._pose(up[k], place[k], float(yaws[m]))
            ranked.append(Found(pose, float(scores[k, m]), float(yaws[m])))
        return _distinct(ranked, most)


def _distinct(ranked: list[Found], most: int) -> list[Found]:
    """Return the best of each neighbourhood, best first."""
    kept: list[Found] = []
    for one in sorted(ranked, key=lambda found: -found.score):
        for other in kept:
            apart = np.hypot(*(one.pose.translation - other.pose.translation)[:2])
            turn = abs(np.angle(np.exp(1j * (one.yaw - other.yaw))))
            if apart < _SAME_M and turn < _SAME_RAD:
                break
        else:
            kept.append(one)
        if len(kept) == most:
            break
    return kept


@numba.njit(cache=True)
def _scores(
    points: NDArray[np.float64],
    weight: NDArray[np.float64],
    turned: NDArray[np.float64],
    place: NDArray[np.float64],
    headings: NDArray[np.float64],
    gain: NDArray[np.float32],
    per_m: float,
) -> NDArray[np.float64]:
    """Return the weighted gain (P, Y) of points (N, 3) at every place and heading."""
    out = np.zeros((len(place), len(headings)))
    for k in range(len(place)):
        for m in range(len(headings)):
            r = np.ascontiguousarray(turned[k]) @ np.ascontiguousarray(headings[m])
            total = 0.0
            for n in range(len(points)):
                x, y, z = points[n]
                i = int((r[0, 0] * x + r[0, 1] * y + r[0, 2] * z + place[k, 0]) * per_m)
                j = int((r[1, 0] * x + r[1, 1] * y + r[1, 2] * z + place[k, 1]) * per_m)
                h = int((r[2, 0] * x + r[2, 1] * y + r[2, 2] * z + place[k, 2]) * per_m)
                if 0 <= i < gain.shape[0] and 0 <= j < gain.shape[1] and 0 <= h < gain.shape[2]:
                    total += weight[n] * gain[i, j, h]
            out[k, m] = total
    return out
