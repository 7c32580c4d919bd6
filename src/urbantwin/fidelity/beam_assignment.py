"""Assignment of a frame's points to the beams of a known sensor."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from urbantwin.errors import InputError
from urbantwin.fidelity.column_assignment import fired_columns
from urbantwin.fidelity.frame import Frame
from urbantwin.geometry import Pose
from urbantwin.lidar import Rig, beam_directions
from urbantwin.lidar import sensor as model_of
from urbantwin.lidar.rig import dataset_frame
from urbantwin.lidar.sensor import Sensor

__all__ = ["BeamsOf", "beams_of_model", "beams_of_rig"]

#: A point farther from every beam than this share of the beam spacing belongs to none.
_ASIDE = 1.0
#: Tolerance of the elevations between units of a model, degrees.
_UNIT_DEG = 0.5
_FRAMES: dict[str, Literal["sensor", "level", "site"]] = {
    "sensor": "sensor",
    "level": "level",
    "site": "site",
}


@dataclass(frozen=True, eq=False)
class BeamsOf:
    """The beams of one sensor in the frame of a recording's points.

    Attributes:
        name: name of the sensor in its rig.
        sensor: model of the sensor.
        columns: columns per rotation.
        turns_per_second: rotations per second.
        points_SE3_sensor: pose of the sensor in the frame of the points.
        rolling: channels that fire later have a larger azimuth (rolling shutter).
        number: the sensor's number in frames of several sensors; ``None``: all points are of this
            sensor.
    """

    name: str
    sensor: Sensor
    columns: int
    turns_per_second: float
    points_SE3_sensor: Pose  # noqa: N815
    rolling: bool = True
    number: int | None = None
    _found: dict[str, cKDTree] = field(default_factory=dict, init=False, repr=False)

    @property
    def count(self) -> int:
        """Number of beams."""
        return self.sensor.channels * self.columns

    @property
    def directions(self) -> NDArray[np.float64]:
        """Unit vectors (C, K, 3) of the beams, sensor frame."""
        return beam_directions(self.sensor, self.columns, turns_per_second=self._turning)

    @property
    def _turning(self) -> float:
        return self.turns_per_second if self.rolling else 0.0

    def of(self, frame: Frame) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
        """Return points (M,) on beams, each beam once, those beams (M,), and all ranges (N,).

        Points are assigned by ring if the rings of the frame match the sensor's channels, in order
        of elevation or in the manufacturer's order, since units differ slightly from their model.
        Otherwise they are assigned to the nearest direction.
        """
        away = self.points_SE3_sensor.inverse().apply(frame.points)
        range_m: NDArray[np.float64] = np.linalg.norm(away, axis=1)
        rows = np.arange(len(away))
        if self.number is not None and frame.sensor is not None:
            rows = np.flatnonzero(frame.sensor == self.number)
        aim = away[rows] / np.maximum(range_m[rows], 1e-9)[:, None]
        channel = None if frame.ring is None else self._channels(frame.ring[rows], aim)
        if channel is None:
            beam, on = self._nearest(aim)
            rows, beam = rows[on], beam[on]
        else:
            azimuth = np.arctan2(aim[:, 1], aim[:, 0])
            column = fired_columns(channel, azimuth, self.columns, self.sensor, self._turning)
            beam = channel * self.columns + column
        once = np.unique(beam, return_index=True)[1]
        return rows[once], beam[once], range_m

    def _channels(
        self, ring: NDArray[np.integer], aim: NDArray[np.float64]
    ) -> NDArray[np.int64] | None:
        table = self.sensor.elevation_deg
        rising = np.argsort(table, kind="stable")
        if not len(ring) or int(ring.min()) < 0 or int(ring.max()) >= len(table):
            return None
        up = np.degrees(np.arcsin(np.clip(aim[:, 2], -1, 1)))
        numbered = (np.arange(len(table)), rising, rising[::-1])
        off = [float(np.percentile(np.abs(up - table[one[ring]]), 90)) for one in numbered]
        best = int(np.argmin(off))
        return np.asarray(numbered[best][ring]) if off[best] <= _UNIT_DEG else None

    def _nearest(self, aim: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        if "tree" not in self._found:
            self._found["tree"] = cKDTree(self.directions.reshape(-1, 3))
        tree = self._found["tree"]
        near, _ = tree.query(tree.data[:: max(1, tree.n // 5000)], k=2)
        aside, beam = tree.query(aim)
        return beam, aside <= _ASIDE * max(float(np.median(near[:, 1])), 2e-3)


def beams_of_model(
    model: str,
    *,
    columns: int | None = None,
    turns_per_second: float | None = None,
    pose: tuple[float, float, float, float, float, float] | None = None,
) -> BeamsOf:
    """Return the beams of a sensor of the catalogue or of a sensor file.

    Args:
        model: the model's name, or the file.
        columns: columns per rotation; the model's default if not given.
        turns_per_second: rotations per second; the model's default if not given.
        pose: x, y, z in metres and yaw, pitch, roll in degrees in the frame of the points.

    Raises:
        InputError: unknown model, unsupported number of columns, or a sensor with a scan pattern.
    """
    sensor = model_of(model)
    if sensor.pattern is not None:
        raise InputError(f"{sensor.name} scans a pattern", expected="a sensor with channels")
    if columns is not None and columns not in sensor.columns_options:
        offered = ", ".join(map(str, sensor.columns_options))
        raise InputError(f"{sensor.name} has no {columns} columns", expected=f"one of {offered}")
    x, y, z, *angles = pose or (0.0,) * 6
    return BeamsOf(
        "",
        sensor,
        columns or sensor.columns,
        turns_per_second or sensor.rate_hz,
        Pose.from_ypr(np.array([x, y, z]), *np.radians(angles)),
    )


def beams_of_rig(
    rig: Rig,
    *,
    only: str | None = None,
    frame: str | None = None,
) -> list[BeamsOf]:
    """Return the beams of all sensors of a rig, or of one of them.

    Args:
        rig: the rig, placed on its twin.
        only: name of the sensor that recorded; all of the rig's if not given.
        frame: frame of the points: ``sensor`` or ``level``, of the first of these sensors, or
            ``site``; the rig's own setting if not given.

    Raises:
        InputError: the rig is mounted on an actor, there is no such sensor or frame, or a sensor
            sways or has a scan pattern.
    """
    points_in = _FRAMES.get(frame or rig.frame)
    if points_in is None:
        raise InputError(f"there is no frame {frame!r}", expected="sensor, level or site")
    names = ", ".join(one.name for one in rig.sensors)
    sensors = [one for one in rig.sensors if only in (None, one.name)]
    if not sensors:
        raise InputError(f"the rig has no sensor {only!r}", expected=f"one of {names}")
    if rig.ride is not None:
        raise InputError("the rig is mounted on a vehicle", expected="a static rig")
    site_SE3_points = dataset_frame(points_in, sensors[0].site_SE3_sensor)
    found = []
    for one in sensors:
        if one.sway is not None or one.sensor.pattern is not None:
            raise InputError(f"{one.name} sways or scans a pattern", expected="beams that repeat")
        found.append(
            BeamsOf(
                one.name,
                one.sensor,
                one.columns,
                one.turns_per_second,
                site_SE3_points.inverse() @ one.site_SE3_sensor,
                one.effects.rolling_shutter,
                one.number if len(sensors) > 1 else None,
            )
        )
    return found
