"""Stations along many roads, and the extent of the carriageway there."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

from urbantwin.geometry import wrapped
from urbantwin.ground import Elevation
from urbantwin.roads.grade_separation import Lift
from urbantwin.roads.model import RAISED_KINDS, ModelRoad, Profile
from urbantwin.roads.model.curve import all_at

__all__ = ["SHARPEST", "RoadGround", "Stations", "stations_of"]

#: Maximum curvature of streets, 1/m: higher values are kinks of the drawing.
SHARPEST = 0.2
#: Distance for curvature and pace at ends, metres.
NEAR_M = 0.02
#: Standard deviation of the regression weights, metres: it removes cars, curbs and noise.
SMOOTHING_M = 5.0
#: Cell size of the regression grid, metres.
CELL_M = 2.0
#: Weight of ground beside the road relative to ground under it: a canal, a retaining wall or an
#: embankment beside a street does not tilt it, and the ground is defined away from roads.
BESIDE = 0.003


@dataclass(frozen=True)
class Stations:
    """Stations of many roads, one road after the other (M in total).

    Attributes:
        roads: the roads.
        first: (R + 1,) index of each road's first station, and M.
        road: (M,) index of the road.
        s: (M,) station along the reference line, metres.
        pose: (M, 3) x, y, heading of the reference line.
        sides: (4, M) offsets to the left, metres: right and left border of the carriageway, and of
            all lanes including footways.
        bend: (2, R) curvature of the reference lines at their starts and ends, 1/m.
        pace: (2, R) metres in plan per metre of station there: not exactly 1 on cubics.
    """

    roads: tuple[ModelRoad, ...]
    first: NDArray[np.int64]
    road: NDArray[np.int64]
    s: NDArray[np.float64]
    pose: NDArray[np.float64]
    sides: NDArray[np.float64]
    bend: NDArray[np.float64]
    pace: NDArray[np.float64]

    @property
    def right(self) -> NDArray[np.float64]:
        """Offset of the carriageway's right border (M,), metres to the left."""
        return np.asarray(self.sides[0])

    @property
    def left(self) -> NDArray[np.float64]:
        """Offset of the carriageway's left border (M,), metres to the left."""
        return np.asarray(self.sides[1])

    @property
    def outer_right(self) -> NDArray[np.float64]:
        """Offset of the outermost right border (M,), footways included, metres to the left."""
        return np.asarray(self.sides[2])

    @property
    def outer_left(self) -> NDArray[np.float64]:
        """Offset of the outermost left border (M,), footways included, metres to the left."""
        return np.asarray(self.sides[3])

    def areas(self, *, outer: bool = False, grown: ArrayLike = 0.0) -> NDArray[np.object_]:
        """Return the area (R,) of each road's carriageway, or of all its lanes.

        Args:
            outer: whether to include footways.
            grown: margin on both sides, metres, for all roads or each (R,).
        """
        if not self.roads:
            return np.zeros(0, object)
        right, left = self.sides[2:] if outer else self.sides[:2]
        margin = np.broadcast_to(np.asarray(grown, np.float64), len(self.roads))[self.road]
        corners = self.beside(np.column_stack([right - margin, left + margin]))
        # Along the right border of a road, and back along its left one.
        begin, end = self.edges()
        back = (begin + end)[self.road] - np.arange(len(self.road))
        order = np.argsort(np.tile(self.road, 2), kind="stable")
        ring = np.concatenate([corners[:, 0], corners[back, 1]])[order]
        rings = shapely.linearrings(ring, indices=np.repeat(self.road, 2))
        polygons: NDArray[np.object_] = shapely.polygons(rings)
        bad = ~shapely.is_valid(polygons)
        polygons[bad] = shapely.buffer(polygons[bad], 0.0)
        return polygons

    def pick(self, roads: Sequence[ModelRoad], which: Sequence[int]) -> Stations:
        """Return the stations of some roads: ``roads``, which had the indices ``which``."""
        parts = [np.arange(self.first[k], self.first[k + 1]) for k in which]
        index = np.concatenate([np.zeros(0, np.int64), *parts])
        counts = [len(part) for part in parts]
        return Stations(
            tuple(roads),
            np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
            np.repeat(np.arange(len(counts)), counts),
            self.s[index],
            self.pose[index],
            self.sides[:, index],
            self.bend[:, list(which)],
            self.pace[:, list(which)],
        )

    def of(self, k: int) -> slice:
        """Return the stations of the ``k``-th road."""
        return slice(int(self.first[k]), int(self.first[k + 1]))

    def beside(self, t: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points (M, K, 2) at offsets (M, K) to the left."""
        heading = self.pose[:, 2, None]
        return np.stack(
            [self.pose[:, :1] - t * np.sin(heading), self.pose[:, 1:2] + t * np.cos(heading)], -1
        )

    def across(
        self, count: int, *, margin: NDArray[np.float64] | float = 0.0
    ) -> NDArray[np.float64]:
        """Return offsets (M, count), evenly spaced over the carriageway without a margin (M,)."""
        right, left = self.right + margin, self.left - margin
        share = np.linspace(0.0, 1.0, count)
        return np.asarray(right[:, None] + (left - right)[:, None] * share)

    def edges(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the indices (R,) of the first and of the last station of each road."""
        return self.first[:-1], self.first[1:] - 1


class RoadGround:
    """Local linear regression of the ground under carriageways, and the lift of ramps and bridges.

    At each point a plane is fitted to nearby cells under carriageways, weighted by a Gaussian
    (Cleveland & Devlin, "Locally weighted regression", JASA 83, 1988). It preserves planes, and a
    road beside a step in the ground stays on its own side.

    Args:
        elevation: the ground.
        lift: height of roads above the ground.
        carriageway: (N, 2) dense points on the carriageways of the ground level.
    """

    def __init__(self, elevation: Elevation, lift: Lift, carriageway: NDArray[np.float64]) -> None:
        self._elevation = elevation
        self._lift = lift
        self._carriageway = carriageway

    def __call__(self, xy: NDArray[np.float64], level: int) -> NDArray[np.float64]:
        """Return heights (N,) at points (N, 2) for roads of a level, metres."""
        xy = np.asarray(xy, np.float64).reshape(-1, 2)
        lift = self._lift.at(xy, level)
        if self._elevation.is_flat:
            return np.asarray(lift + self._elevation.raw.flat[0])
        grid, place = self._grid
        pixel = (xy - place[:2]) / place[2]
        z = map_coordinates(grid, [pixel[:, 1], pixel[:, 0]], order=1, mode="nearest")
        return np.asarray(z + lift)

    def lift_at(self, xy: NDArray[np.float64], level: int) -> NDArray[np.float64]:
        """Return the lift (N,) of roads of a level at points (N, 2), metres."""
        return self._lift.at(xy, level)

    @cached_property
    def _grid(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Regressed heights, and the position and size of their cells."""
        ground = self._elevation
        block = max(1, round(CELL_M / ground.step))
        weight = np.full(ground.raw.shape, BESIDE)
        cell = np.round((self._carriageway - [ground.west, ground.south]) / ground.step).astype(int)
        rows, columns = ground.raw.shape
        inside = (cell >= 0).all(axis=1) & (cell[:, 0] < columns) & (cell[:, 1] < rows)
        weight[cell[inside, 1], cell[inside, 0]] = 1.0
        # Moments of weight, position and height; the border's cells extend beyond the grid.
        pad = [(0, -n % block) for n in (rows, columns)]
        weight, z = np.pad(weight, pad, mode="edge"), np.pad(ground.raw, pad, mode="edge")
        y, x = (
            np.pad(np.arange(n, dtype=np.float64), side, mode="edge")
            for n, side in zip((rows, columns), pad, strict=True)
        )
        x, y = x[None, :], y[:, None]
        sigma = max(SMOOTHING_M, ground.detail / 2) / ground.step / block

        def moment(value: NDArray[np.float64]) -> NDArray[np.float64]:
            shape = (z.shape[0] // block, block, z.shape[1] // block, block)
            summed = (weight * value).reshape(shape).sum(axis=(1, 3))
            return np.asarray(gaussian_filter(summed, sigma, mode="nearest", truncate=3.0))

        w, wx, wy, wz = moment(np.ones_like(z)), moment(x + 0 * y), moment(y + 0 * x), moment(z)
        wxx, wxy, wyy = moment(x * x + 0 * y), moment(x * y), moment(y * y + 0 * x)
        wxz, wyz = moment(x * z), moment(y * z)
        mx, my, mz = wx / w, wy / w, wz / w
        xx, xy, yy = wxx / w - mx * mx, wxy / w - mx * my, wyy / w - my * my
        xz, yz = wxz / w - mx * mz, wyz / w - my * mz
        scale = xx * yy - xy * xy
        east, north = (yy * xz - xy * yz) / scale, (xx * yz - xy * xz) / scale
        nodes = [(np.arange(n) + 0.5) * block - 0.5 for n in w.shape]
        fitted = mz + east * (nodes[1][None, :] - mx) + north * (nodes[0][:, None] - my)
        step = ground.step * block
        place = np.array(
            [
                ground.west + nodes[1][0] * ground.step,
                ground.south + nodes[0][0] * ground.step,
                step,
            ]
        )
        return fitted, place


def stations_of(roads: Sequence[ModelRoad], step: float, turn: float = math.inf) -> Stations:
    """Return evenly spaced stations along roads, at least three per road, including both ends.

    Args:
        roads: the roads.
        step: maximum spacing, metres.
        turn: maximum mean change of heading between stations, radians.
    """
    counts = [
        max(
            3,
            math.ceil(road.length / step) + 1,
            math.ceil(_turning(road) / turn) + 1 if turn < math.inf else 0,
        )
        for road in roads
    ]
    first = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    s = [np.linspace(0.0, road.length, n) for road, n in zip(roads, counts, strict=True)]
    offsets = [min(NEAR_M, road.length / 50) for road in roads]
    curves = [road.curve for road in roads]
    pose = all_at(curves, s)
    # Curvature and pace at the ends are measured just inside.
    inside = [np.array([d, road.length - d]) for road, d in zip(roads, offsets, strict=True)]
    ends = pose[np.column_stack([first[:-1], first[1:] - 1])]
    change = (all_at(curves, inside).reshape(-1, 2, 3) - ends) * [[[1.0], [-1.0]]]
    reach = [_borders(road, x) for road, x in zip(roads, s, strict=True)]
    sides = np.concatenate([np.zeros((4, 0)), *reach], axis=1)
    offset_m = np.array(offsets, np.float64)[:, None]
    turned = wrapped(change[:, :, 2])
    return Stations(
        tuple(roads),
        first,
        np.repeat(np.arange(len(counts)), counts),
        np.concatenate([np.zeros(0), *s]),
        pose,
        sides,
        (turned / offset_m).T,
        (np.hypot(change[:, :, 0], change[:, :, 1]) / offset_m).T,
    )


def _turning(road: ModelRoad) -> float:
    """Return the approximate total turn of the reference line, radians."""
    pieces = road.curve.pieces
    arcs = sum(abs(piece.curvature) * piece.length for piece in pieces)
    cubics = [piece.heading for piece in pieces if piece.u]
    return arcs + sum(abs(wrapped(b - a)) for a, b in itertools.pairwise(cubics))


def _values(
    profile: Profile, s: NDArray[np.float64], least: float = -math.inf
) -> NDArray[np.float64] | float:
    """Return values (N,) of a profile at stations, or its constant value."""
    if profile.constant_value is not None:
        return max(profile.constant_value, least)
    return np.maximum(profile.at(s), least)


def _borders(road: ModelRoad, s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (4, N): right and left border of the carriageway, and of all lanes."""
    borders = np.zeros((4, len(s)))
    starts = np.searchsorted(s, [section.s for section in road.sections[1:]]).tolist()
    for section, (begin, end) in zip(
        road.sections, itertools.pairwise([0, *starts, len(s)]), strict=True
    ):
        if begin == end:
            continue
        inside = slice(begin, end)
        offset = _values(road.offset, s[inside])
        borders[:, inside] = offset
        for side in (-1, 1):
            t = offset
            flat = offset
            for number in range(side, side * (len(section.lanes) + 1), side):
                lane = section.by_id.get(number)
                if lane is None:
                    break
                t = t + side * _values(lane.width, s[inside] - section.s, least=0.0)
                if lane.kind not in RAISED_KINDS and lane.kind != "none":
                    flat = t
            borders[0 if side < 0 else 1, inside] = flat
            borders[2 if side < 0 else 3, inside] = t
    # On a road of footways only, they are the carriageway.
    bare = borders[1] - borders[0] < 0.5
    borders[:2, bare] = borders[2:, bare]
    return borders
