"""Matching of two frames in plan: rotation, mirroring and shift from one to the other.

Points above the ground are rasterised in plan, one image per height band; the images of both frames
are correlated by FFT at every heading. Images are high-pass filtered, so that edges count and not
the point density (all frames are densest around the sensor). Iterated closest points in plan (Besl
and McKay 1992) refine the best placement.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft2, rfft2
from scipy.ndimage import minimum_filter
from scipy.spatial import cKDTree

__all__ = ["Match", "Matches", "PlanMotion", "Standing", "agreement", "best_match", "standing"]

Array = NDArray[np.float64]

#: Heights above the surrounding ground between which points are used, metres.
_LOW_M, _HIGH_M = 0.7, 15.0
#: Maximum distance of the points from the centre, metres.
_FAR_M = 60.0
#: The ground is the lowest point in windows of this many cells of this size (metres), at most half
#: a metre plus this slope off the most frequent height.
_GROUND_CELL_M, _GROUND_CELLS, _STEEPEST = 2.0, 5, 0.15
#: One point is kept per voxel of this size, metres, and of those this many at random.
_THINNED_M, _MOST = 0.4, 3000
#: Cell size of the images, metres, and their cells per side.
_CELL_M, _CELLS = 1.0, 192
_BANDS_M = (_LOW_M, 2.0, 4.0, _HIGH_M)
#: Standard deviations of the smoothing and of the subtracted background, cells.
_FINE, _COARSE = 0.7, 2.0
_STEP_DEG = 3
#: Shifts up to this many cells count as none.
_UNMOVED = 2
#: Headings that differ by less are the same, degrees.
_SAME_DEG = 8.0
#: Maximum distance of matching points, metres.
_MATCHED_M = 0.6


@dataclass(frozen=True, eq=False)
class PlanMotion:
    """A rotation about the frame's origin (after y is negated, if mirrored), then a shift.

    Attributes:
        yaw: radians counter-clockwise.
        shift: x and y, metres.
        mirrored: y is negated first.
    """

    yaw: float = 0.0
    shift: tuple[float, float] = (0.0, 0.0)
    mirrored: bool = False

    @property
    def matrix(self) -> Array:
        """The linear part (2, 2)."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        y = -1.0 if self.mirrored else 1.0
        return np.array([[c, -s * y], [s, c * y]])

    def apply(self, plan: Array) -> Array:
        """Return (N, 2) points moved."""
        return np.asarray(plan @ self.matrix.T + self.shift)


@dataclass(frozen=True, eq=False)
class Standing:
    """The points of a frame that lie above its ground.

    Attributes:
        points: (K, 3): x, y in the frame; height above the surrounding ground, metres.
        middle: (2,) median of the frame's points in plan.
        ground: (G, 3) lowest points of cells: x, y, z in the frame.
    """

    points: Array
    middle: Array
    ground: Array

    def moved(self, motion: PlanMotion) -> Standing:
        """Return the points moved in plan."""
        return Standing(
            np.column_stack([motion.apply(self.points[:, :2]), self.points[:, 2]]),
            motion.apply(self.middle[None])[0],
            np.column_stack([motion.apply(self.ground[:, :2]), self.ground[:, 2]]),
        )


@dataclass(frozen=True, eq=False)
class Match:
    """A placement of one frame on another.

    Attributes:
        motion: moves the first frame onto the second.
        strength: correlation relative to the best of any other heading; about 1 for different
            places.
    """

    motion: PlanMotion
    strength: float


@dataclass(frozen=True, eq=False)
class Matches:
    """The best placements of one frame on another.

    Attributes:
        anywhere: the best placement.
        in_place: the best rotation about the frame's origin without a shift, compared with other
            such rotations.
        as_it_is: correlation without a motion, relative to the best of any heading but that of
            ``anywhere``.
    """

    anywhere: Match
    in_place: Match
    as_it_is: float


def standing(points: Array) -> Standing:
    """Return the points above the surrounding ground, of (N, 3) points in metres with z up."""
    middle = np.median(points[:, :2], axis=0)
    chosen = points[np.hypot(*(points[:, :2] - middle).T) < _FAR_M]
    away = np.hypot(*(chosen[:, :2] - middle).T)
    if not len(chosen):
        return Standing(np.zeros((0, 3)), middle, np.zeros((0, 3)))
    near = chosen[away < _FAR_M / 3, 2]
    heights, count = np.unique(np.floor(near / 0.2), return_counts=True)
    level = float(heights[count.argmax()]) * 0.2 + 0.1 if len(near) else float(chosen[:, 2].min())
    cells = np.floor((chosen[:, :2] - middle + _FAR_M) / _GROUND_CELL_M).astype(int)
    edge = int(2 * _FAR_M / _GROUND_CELL_M) + 1
    lowest = np.full((edge, edge), np.inf)
    np.minimum.at(lowest, (cells[:, 0], cells[:, 1]), chosen[:, 2])
    around = minimum_filter(lowest, _GROUND_CELLS, mode="nearest")[cells[:, 0], cells[:, 1]]
    off = 0.5 + _STEEPEST * away
    above = chosen[:, 2] - np.clip(around, level - off, level + off)
    tall = (above > _LOW_M) & (above < _HIGH_M)
    found = np.column_stack([chosen[tall, :2], above[tall]])
    _, first = np.unique(np.floor(found / _THINNED_M), axis=0, return_index=True)
    chance = np.random.default_rng(len(first)).permutation(len(first))[:_MOST]
    x, y = np.nonzero(np.abs(lowest - level) < 0.5 + _STEEPEST * _FAR_M)
    places = (np.column_stack([x, y]) + 0.5) * _GROUND_CELL_M - _FAR_M + middle
    return Standing(found[first[np.sort(chance)]], middle, np.column_stack([places, lowest[x, y]]))


def agreement(one: Standing, other: Standing) -> tuple[float, float]:
    """Return the share of each frame's points within 0.6 m of a point of the other, both ways."""
    if not len(one.points) or not len(other.points):
        return 0.0, 0.0
    both = ((one.points, other.points), (other.points, one.points))
    there, back = (
        float(np.isfinite(cKDTree(b).query(a, distance_upper_bound=_MATCHED_M)[0]).mean())
        for a, b in both
    )
    return there, back


def best_match(one: Standing, other: Standing) -> Matches | None:
    """Return the placements of the first frame on the second; None if one of them is empty."""
    if not len(one.points) or not len(other.points):
        return None
    target = _band_pass() * np.conj(rfft2(_pictures(other.points, other.middle), axes=(1, 2)))
    turns = [
        PlanMotion(float(np.radians(degrees)), mirrored=mirrored)
        for mirrored in (False, True)
        for degrees in range(0, 360, _STEP_DEG)
    ]
    peak, stays = np.zeros((2, len(turns)))
    shift = np.zeros((len(turns), 2))
    for index, turn in enumerate(turns):
        moved = one.moved(turn)
        seen = rfft2(_pictures(moved.points, moved.middle), axes=(1, 2))
        score = irfft2((seen * target).sum(axis=0), s=(_CELLS, _CELLS))
        at = np.array(np.unravel_index(score.argmax(), score.shape))
        peak[index] = score.max()
        lag = np.where(at > _CELLS // 2, at - _CELLS, at) * _CELL_M
        shift[index] = other.middle - moved.middle - lag
        unmoved = np.round((other.middle - moved.middle) / _CELL_M).astype(int)
        if (np.abs(unmoved) < _CELLS // 2).all():
            reach = np.arange(-_UNMOVED, _UNMOVED + 1)
            stays[index] = score[np.ix_(unmoved[0] + reach, unmoved[1] + reach)].max()
    best, in_place = int(peak.argmax()), int(stays.argmax())
    others = peak[_apart(turns, best)].max()
    start = replace(turns[best], shift=(float(shift[best, 0]), float(shift[best, 1])))
    return Matches(
        Match(_settled(one, other, start), float(peak[best] / others)),
        Match(
            _settled(one, other, turns[in_place]),
            float(stays[in_place] / max(stays[_apart(turns, in_place)].max(), 1e-9)),
        ),
        float(stays[0] / others),
    )


def _apart(turns: list[PlanMotion], chosen: int) -> NDArray[np.bool_]:
    """Return the mask of motions with another heading or handedness than the chosen one."""
    yaw = np.array([turn.yaw for turn in turns])
    other = np.array([turn.mirrored for turn in turns]) != turns[chosen].mirrored
    away = np.abs(np.angle(np.exp(1j * (yaw - yaw[chosen]))))
    return np.asarray(other | (away > np.radians(_SAME_DEG)))


def _band_pass() -> Array:
    """Return the squared transfer function of the band-pass: a difference of two Gaussians."""
    row, column = np.fft.fftfreq(_CELLS)[:, None], np.fft.rfftfreq(_CELLS)[None]
    squared = -2 * np.pi**2 * (row**2 + column**2)
    return np.asarray((np.exp(squared * _FINE**2) - np.exp(squared * _COARSE**2)) ** 2)


def _pictures(points: Array, middle: Array) -> NDArray[np.float32]:
    """Return the images of the points in plan around the centre, (B, cells, cells)."""
    cells = np.floor((points[:, :2] - middle) / _CELL_M).astype(int) + _CELLS // 2
    inside = ((cells >= 0) & (cells < _CELLS)).all(axis=1)
    band = np.digitize(points[inside, 2], _BANDS_M) - 1
    seen = np.zeros((len(_BANDS_M) - 1, _CELLS, _CELLS), np.float32)
    seen[band, cells[inside, 0], cells[inside, 1]] = 1.0
    return seen


def _settled(one: Standing, other: Standing, start: PlanMotion) -> PlanMotion:
    """Return a motion refined by closest points in plan, with decreasing reach."""
    tree = cKDTree(other.points)
    plan = one.points[:, :2] * [1.0, -1.0 if start.mirrored else 1.0]
    motion = replace(start, mirrored=False)
    for reach in (2.5, 2.0, 1.6, 1.3, 1.0, 0.8, 0.8, 0.6, 0.6, 0.6):
        moved = np.column_stack([motion.apply(plan), one.points[:, 2]])
        away, near = tree.query(moved, distance_upper_bound=reach)
        met = np.isfinite(away)
        if met.sum() < 10:
            break
        a, b = plan[met], other.points[near[met], :2]
        middle, onto = a.mean(axis=0), b.mean(axis=0)
        cross = (a - middle).T @ (b - onto)
        yaw = float(np.arctan2(cross[0, 1] - cross[1, 0], cross[0, 0] + cross[1, 1]))
        x, y = onto - PlanMotion(yaw).matrix @ middle
        motion = PlanMotion(yaw, (float(x), float(y)))
    return replace(motion, mirrored=start.mirrored)
