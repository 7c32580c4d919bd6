"""Placement: the height and tilt of actors, from the ground under their wheels."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import (
    DownwardProbe,
    LabelledMesh,
    rotation_from_ypr,
    stations_of_points,
)
from urbantwin.roads import RoadNetwork

__all__ = ["Ground", "stand"]

_CLEARANCE_M = 1.5  # start of rays above the lane: below the deck of any crossing road
_MAX_TILT_RAD = np.radians(17.0)  # a steeper fit means a wheel on top of a wall
_ROUNDS = 2  # the contacts' positions depend on the tilt; the second round is exact


class Ground:
    """The ground below actors, on the level of their lane.

    Args:
        mesh: triangles of the ground.
        roads: the road network, for the height of each lane.
    """

    def __init__(self, mesh: LabelledMesh, roads: RoadNetwork) -> None:
        self._probe = DownwardProbe(mesh)
        self._roads = roads
        self._highest = float(mesh.vertices[:, 2].max(initial=0.0)) + _CLEARANCE_M

    def top(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the height (N,) of the highest ground at points (N, 2); nan if there is none."""
        return self.height(xy, np.full(len(xy), self._highest))

    def levels(self, names: Sequence[str]) -> NDArray[np.int64]:
        """Return the level (L,) of lanes by name; 0 for unknown ones."""
        lane_by_id = self._roads.lane_by_id
        rails = {f"{track.id}_0": track.level for track in self._roads.tracks}
        lane_levels = [
            lane_by_id[name].level if name in lane_by_id else rails.get(name, 0) for name in names
        ]
        return np.array(lane_levels, np.int64)

    def ceiling(
        self, xy: NDArray[np.float64], lane: NDArray[np.int32], names: tuple[str, ...]
    ) -> NDArray[np.float64]:
        """Return the start height (N,) of rays for points (N, 2) on lanes (N,)."""
        start = np.full(len(xy), self._highest)
        rails = {f"{track.id}_0": track for track in self._roads.tracks if not track.level}
        order = np.argsort(lane, kind="stable")
        for group in np.split(order, np.flatnonzero(np.diff(lane[order])) + 1):
            name = names[lane[group[0]]] if len(group) else ""
            if name in self._roads.lane_by_id:
                start[group] = self._roads.height(name, xy[group]) + _CLEARANCE_M
            elif name in rails:
                start[group] = _height_along(rails[name].line, xy[group]) + _CLEARANCE_M
        return start

    def height(self, xy: NDArray[np.float64], ceiling: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the height (N,) of the ground under points (N, 2); nan if there is none."""
        return self._probe.height_below(np.column_stack([xy, ceiling]))


def _height_along(line: NDArray[np.float64], xy: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the height (N,) of the nearest point of a line (P, 3) to points (N, 2)."""
    station_m = shapely.line_locate_point(shapely.LineString(line[:, :2]), shapely.points(xy))
    return np.asarray(np.interp(station_m, stations_of_points(line[:, :2]), line[:, 2]))


def stand(
    ground: Ground,
    contacts: NDArray[np.float64],
    xy: NDArray[np.float64],
    yaw: NDArray[np.float64],
    ceiling: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Place one asset on the ground at N poses.

    The least-squares plane through the ground under the contacts gives height, pitch and roll; two
    contacts in line give no roll, a single one neither.

    Args:
        ground: the ground.
        contacts: (K, 3) contacts of the asset, in its own frame.
        xy: (N, 2) the asset's origin, site frame.
        yaw: (N,) heading, rad.
        ceiling: (N,) start height of rays.

    Returns:
        z, pitch and roll, each (N,); z is nan where the origin or a contact is not over ground.
    """
    pitch, roll = np.zeros(len(xy)), np.zeros(len(xy))
    rolls = bool(np.ptp(contacts[:, 1]) > 0.1)
    pitches = bool(np.ptp(contacts[:, 0]) > 0.1)
    z = ground.height(xy, ceiling)
    for _ in range(_ROUNDS):
        turned = _rotated(contacts, yaw, pitch, roll)
        points = (xy[:, None] + turned[..., :2]).reshape(-1, 2)
        heights = ground.height(points, np.repeat(ceiling, len(contacts)))
        heights = heights.reshape(len(xy), len(contacts))
        c, s = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
        ahead = turned[..., 0] * c + turned[..., 1] * s
        left = turned[..., 1] * c - turned[..., 0] * s
        beyond = np.isnan(heights).any(axis=1)
        z[beyond], heights[beyond] = np.nan, 0.0
        slope_ahead, slope_left = _fitted_slopes(ahead, left, heights, pitches=pitches, rolls=rolls)
        pitch = np.clip(np.arctan(-slope_ahead) + 0.0, -_MAX_TILT_RAD, _MAX_TILT_RAD)
        roll = np.clip(np.arctan(slope_left * np.cos(pitch)), -_MAX_TILT_RAD, _MAX_TILT_RAD)
        lift = heights - _rotated(contacts, yaw, pitch, roll)[..., 2]
        z = np.where(np.isnan(z), np.nan, lift.mean(axis=1))
    return z, pitch, roll


def _rotated(
    contacts: NDArray[np.float64],
    yaw: NDArray[np.float64],
    pitch: NDArray[np.float64],
    roll: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return contacts (N, K, 3) turned by N attitudes."""
    return np.asarray(contacts @ rotation_from_ypr(yaw, pitch, roll).transpose(0, 2, 1))


def _fitted_slopes(
    ahead: NDArray[np.float64],
    left: NDArray[np.float64],
    heights: NDArray[np.float64],
    *,
    pitches: bool,
    rolls: bool,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the slopes ahead and to the left (N,) of planes fitted to (N, K) heights."""
    unknown = [column for column, wanted in ((ahead, pitches), (left, rolls)) if wanted]
    slopes = np.zeros((2, len(heights)))
    if unknown:
        design = np.stack([np.ones_like(ahead), *unknown], axis=-1)
        fit = np.linalg.pinv(design) @ heights[..., None]
        slopes[[pitches, rolls]] = fit[:, 1:, 0].T
    return slopes[0], slopes[1]
