"""Frames of fixed sensors, with sensor, ring and column of every point."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact import read_json
from urbantwin.artefact.arrays import read_array
from urbantwin.artefact.manifest import Part, validated
from urbantwin.errors import InputError
from urbantwin.geometry import Pose

__all__ = ["RecordedFrame", "RecordedFrames", "RecordingSensor"]

_EXPECTED = "frames with rings, as urbantwin rig discover --frames writes them"
_MOST_METRES = 1e6
#: Size of the cache of frames, bytes, as frames are read several times.
_KEPT_BYTES = 1 << 30


class RecordingSensor(Part):
    """One of the sensors of a recording, as in ``discovery.json``.

    Attributes:
        name: name of the sensor.
        east_m, north_m, up_m: its position in the frame of the points.
        pitch_deg, roll_deg: its attitude at a yaw of 0.
        columns: columns per rotation of 360 degrees.
        channels: number of rings.
    """

    name: str
    east_m: float
    north_m: float
    up_m: float
    pitch_deg: float
    roll_deg: float
    columns: int
    channels: int

    @property
    def place(self) -> NDArray[np.float64]:
        """Position (3,), metres."""
        return np.array([self.east_m, self.north_m, self.up_m])

    @property
    def pose(self) -> Pose:
        """Pose of the sensor, with a yaw of 0, in the frame of the points."""
        pitch, roll = np.radians([self.pitch_deg, self.roll_deg])
        return Pose.from_ypr(self.place, 0.0, pitch, roll)


class _Discovery(Part):
    sensors: list[RecordingSensor]


@dataclass(frozen=True, eq=False)
class RecordedFrame:
    """One frame.

    Attributes:
        name: name of its files.
        points: (N, 3) float64, metres, in one frame of reference for all frames, z up.
        sensor: (N,) int64 index of the sensor, -1 for points on no ring.
        ring: (N,) int64, or -1.
        column: (N,) int64, or -1.
    """

    name: str
    points: NDArray[np.float64]
    sensor: NDArray[np.int64]
    ring: NDArray[np.int64]
    column: NDArray[np.int64]


class RecordedFrames:
    """A folder of ``urbantwin rig discover --frames``: frames and their sensors.

    Attributes:
        folder: the folder.
        sensors: the sensors.
        names: names of the frames, in order of time.

    Raises:
        InputError: the folder is of another kind.
    """

    def __init__(self, folder: Path) -> None:
        file = folder / "discovery.json"
        if not file.is_file():
            raise InputError(
                "holds no discovery.json",
                file=folder,
                expected="a folder that `urbantwin rig discover FRAMES -o rig.yaml --frames FOLDER`"
                " wrote",
            )
        told = validated(
            read_json(file, kind="discovery"), _Discovery, file=file, expected=_EXPECTED
        )
        self.folder = folder
        self._kept: dict[int, RecordedFrame] = {}
        self._room = _KEPT_BYTES
        self.sensors: tuple[RecordingSensor, ...] = tuple(told.sensors)
        self.names: tuple[str, ...] = tuple(
            sorted(path.stem for path in (folder / "points").glob("*.npy"))
        )
        if not self.sensors or not self.names:
            what = "frames" if self.sensors else "sensors"
            raise InputError(f"holds no {what}", file=folder, expected=_EXPECTED)

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.names)

    def files(self) -> list[Path]:
        """Return the files that are read."""
        parts = [
            self.folder / part / f"{name}.npy" for name in self.names for part in ("points", "rays")
        ]
        return [self.folder / "discovery.json", *parts]

    def read(self, number: int) -> RecordedFrame:
        """Return a frame; its arrays must not be modified.

        Raises:
            InputError: a file is missing, damaged, or does not match the other.
        """
        if number in self._kept:
            return self._kept[number]
        frame = self._read(number)
        size = sum(one.nbytes for one in (frame.points, frame.sensor, frame.ring, frame.column))
        if size <= self._room:
            self._room -= size
            self._kept[number] = frame
        return frame

    def _read(self, number: int) -> RecordedFrame:
        name = self.names[number]
        file = self.folder / "points" / f"{name}.npy"
        points = read_array(file, _EXPECTED)
        if points.ndim != 2 or points.shape[1] < 3 or points.dtype.kind != "f":
            raise InputError(f"is an array of shape {points.shape}", file=file, expected=_EXPECTED)
        xyz = points[:, :3].astype(np.float64)
        if not (np.abs(xyz) < _MOST_METRES).all():  # nor NaN
            raise InputError("has points that are no places", file=file, expected="metres")
        file = self.folder / "rays" / f"{name}.npy"
        rays = read_array(file, _EXPECTED)
        fields = ("sensor", "ring", "column")
        named = rays.dtype.names or ()
        if not set(fields) <= set(named) or rays.shape != (len(points),):
            raise InputError(
                f"is an array of shape {rays.shape} of {', '.join(named) or 'numbers'}",
                file=file,
                expected="sensor, ring and column of each point",
            )
        sensor, ring, column = (rays[field].astype(np.int64) for field in fields)
        self._check(file, sensor, ring, column)
        return RecordedFrame(name, xyz, sensor, ring, column)

    def _check(
        self,
        file: Path,
        sensor: NDArray[np.int64],
        ring: NDArray[np.int64],
        column: NDArray[np.int64],
    ) -> None:
        """Raise an error for unknown sensors, rings and columns."""
        known = sensor >= 0
        if sensor.max(initial=-1) >= len(self.sensors):
            problem = f"names sensor {sensor.max()} of {len(self.sensors)}"
            raise InputError(problem, file=file, expected="the folder's own discovery.json")
        rings = np.array([one.channels for one in self.sensors])[sensor[known]]
        columns = np.array([one.columns for one in self.sensors])[sensor[known]]
        for what, value, most in (("ring", ring[known], rings), ("column", column[known], columns)):
            if ((value < 0) | (value >= most)).any():
                raise InputError(
                    f"has a {what} that its sensor has not",
                    file=file,
                    expected="the folder's own discovery.json",
                )
