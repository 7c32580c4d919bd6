"""Actors with prescribed paths, which are not simulated, placed on the twin's ground."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.progress import Progress, each, untold
from urbantwin.taxonomy import BOX_SEMANTICS
from urbantwin.traffic.assets import Asset, Fleet, asset, asset_names
from urbantwin.traffic.motion import ACTOR_SCHEMA, step_times
from urbantwin.traffic.paths.lane_below import LanesBelow
from urbantwin.traffic.paths.placement import Ground, stand
from urbantwin.traffic.solid_scene import Solid
from urbantwin.twin import Twin

__all__ = ["PrescribedPath", "TwinSurface", "prescribed_table", "usual_asset"]

_STANDING_MS = 0.15  # below this speed, m/s, an actor counts as standing
_GOLDEN_RATIO = (5**0.5 - 1) / 2  # spreads the first gait phases
_MIN_EXTENT_M = 0.3  # a path with a smaller extent has no direction of travel
_TIME_TOLERANCE_S = 1e-6


@dataclass(frozen=True, eq=False)
class PrescribedPath:
    """Positions of an actor at N times, linear in between.

    Attributes:
        actor_class: one of ``taxonomy.BOX_SEMANTICS``.
        asset: name of its mesh, including colour and size if any.
        time_s: (N,) ascending times, seconds from the motion's start. The actor is present from the
            first to the last.
        xy: (N, 2) centre of its bounds, site frame, metres.
        yaw: (N,) heading, rad; ``None``: the direction of travel.
        speed: (N,) m/s along the heading; ``None``: derived from the path.
        z: (N,) approximate height, metres, which distinguishes a bridge from the road below;
            ``None``: the level of its lane.
        absent: intervals (from, to), seconds, during which it is absent.
    """

    actor_class: str
    asset: str
    time_s: NDArray[np.float64]
    xy: NDArray[np.float64]
    yaw: NDArray[np.float64] | None = None
    speed: NDArray[np.float64] | None = None
    z: NDArray[np.float64] | None = None
    absent: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            InputError: unknown class or mesh, times that do not ascend, or values that are not
                finite.
        """
        if self.actor_class not in BOX_SEMANTICS:
            raise InputError(
                f"unknown actor class '{self.actor_class}'", expected=", ".join(BOX_SEMANTICS)
            )
        asset(self.asset)
        count = len(self.time_s)
        if count == 0 or self.xy.shape != (count, 2):
            raise InputError(
                f"a path of {count} moments and {len(self.xy)} places",
                expected="a place (x, y) for every moment, one at least",
            )
        if (np.diff(self.time_s) <= 0).any():
            row = int(np.argmax(np.diff(self.time_s) <= 0)) + 1
            raise InputError("time does not go on", place=f"moment {row}", expected="later times")
        columns = (self.time_s, self.xy, self.yaw, self.speed, self.z)
        if not all(column is None or np.isfinite(column).all() for column in columns):
            raise InputError("a path with values that are not finite")

    def heading(self) -> NDArray[np.float64]:
        """Return the heading (N,), rad, unwrapped."""
        if self.yaw is not None:
            return np.unwrap(self.yaw)
        moved = np.zeros_like(self.xy) if len(self.xy) < 2 else np.gradient(self.xy, axis=0)
        facing = np.arctan2(moved[:, 1], moved[:, 0])
        moving = np.flatnonzero(np.linalg.norm(moved, axis=1) > 1e-3)
        if not len(moving) or float(np.ptp(self.xy, axis=0).max()) < _MIN_EXTENT_M:
            return np.full(len(self.xy), facing[moving[0]] if len(moving) else 0.0)
        return np.asarray(np.interp(np.arange(len(facing)), moving, np.unwrap(facing[moving])))

    def pace(self, heading: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the speed (N,) along a heading (N,), m/s."""
        if self.speed is not None:
            return self.speed
        if len(self.time_s) < 2:
            return np.zeros(len(self.time_s))
        velocity = np.gradient(self.xy, self.time_s, axis=0)
        return velocity[:, 0] * np.cos(heading) + velocity[:, 1] * np.sin(heading)


class TwinSurface:
    """Surface of a twin for prescribed actors: its ground, lanes and static obstacles.

    Args:
        twin: the twin.
    """

    def __init__(self, twin: Twin) -> None:
        self.ground = Ground(twin.ground_mesh, twin.roads)
        self.lanes = LanesBelow(twin.roads)
        self.solid = Solid(twin)


def usual_asset(actor_class: str, number: int) -> str:
    """Return the asset, with its colour, of the n-th actor of a class without further information.

    The asset is rigid, since no motion of further bodies is prescribed.

    Raises:
        InputError: there is no such class.
    """
    asset_names(actor_class)
    return Fleet().body(actor_class, number, bends=False)


def prescribed_table(
    paths: Sequence[PrescribedPath],
    surface: TwinSurface,
    *,
    steps: int,
    step_s: float,
    first_track: int = 1,
    tell: Progress = untold,
) -> tuple[pa.Table, int]:
    """Return the rows of actors with given paths, and the number of poses beside the ground.

    Poses beside the ground are left out. The track id follows from the index of the path alone.

    Args:
        paths: the paths.
        surface: the twin's surface.
        steps: number of steps of the motion.
        step_s: time between steps, seconds.
        first_track: track id of the first path.
        tell: called with the fraction done (0..1) and what is being done.
    """
    times = step_times(steps, step_s)
    parts, outside = [], 0
    for number, path in each(list(enumerate(paths)), tell, "on the ground"):
        begin, end = path.time_s[0] - _TIME_TOLERANCE_S, path.time_s[-1] + _TIME_TOLERANCE_S
        present_s = times[(times >= begin) & (times <= end)]
        for absent_from_s, absent_to_s in path.absent:
            present_s = present_s[
                (present_s <= absent_from_s + _TIME_TOLERANCE_S)
                | (present_s >= absent_to_s - _TIME_TOLERANCE_S)
            ]
        rows = _rows(path, present_s, first_track + number, surface)
        on_ground = np.isfinite(rows["z"])
        outside += int((~on_ground).sum())
        parts.append({name: values[on_ground] for name, values in rows.items()})
    if not parts:
        return ACTOR_SCHEMA.empty_table(), 0
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    order = np.lexsort([columns["track"], columns["time_s"]])
    arrays = [pa.array(columns[field.name][order], field.type) for field in ACTOR_SCHEMA]
    return pa.table(arrays, schema=ACTOR_SCHEMA), outside


def _rows(
    path: PrescribedPath, times: NDArray[np.float64], track: int, surface: TwinSurface
) -> dict[str, NDArray[np.generic]]:
    """Return the columns of one actor at the steps at which it is present."""
    mesh, heading = asset(path.asset), path.heading()
    x, y, yaw, speed = (
        np.interp(times, path.time_s, values)
        for values in (*path.xy.T, heading, path.pace(heading))
    )
    xy = np.column_stack([x, y])
    height = None if path.z is None else np.interp(times, path.time_s, path.z)
    lane = surface.lanes.at(xy, yaw, path.actor_class, height)
    names, which = np.unique(lane.astype(str), return_inverse=True)
    ceiling = surface.ground.ceiling(xy, which.astype(np.int32), tuple(names.tolist()))
    z, pitch, roll = stand(surface.ground, mesh.supports, xy, yaw, ceiling)
    values = {
        "time_s": times,
        "track": track,
        "class": path.actor_class,
        "asset": path.asset,
        "phase": _phases(mesh, path, times, speed, track),
        "x": x,
        "y": y,
        "z": z,
        "yaw": np.angle(np.exp(1j * yaw)),
        "pitch": pitch,
        "roll": roll,
        "length": mesh.length,
        "width": mesh.width,
        "height": mesh.height,
        "speed": speed,
        "lane": lane,
    }
    return {name: np.broadcast_to(np.asarray(value), times.shape) for name, value in values.items()}


def _phases(
    mesh: Asset,
    path: PrescribedPath,
    times: NDArray[np.float64],
    speed: NDArray[np.float64],
    track: int,
) -> NDArray[np.int16]:
    """Return the gait phase at each step: by distance travelled, or standing."""
    moving = np.zeros(len(times))
    if mesh.phases > 1:
        travelled_m = np.concatenate(
            [[0.0], np.cumsum(np.linalg.norm(np.diff(path.xy, axis=0), axis=1))]
        )
        cycles = np.interp(times, path.time_s, travelled_m) / mesh.stride_m + track * _GOLDEN_RATIO
        moving = np.floor(cycles % 1.0 * mesh.phases).clip(0, mesh.phases - 1)
    halted = np.abs(speed) < _STANDING_MS
    return np.where(halted, mesh.standing, moving).astype(np.int16)
