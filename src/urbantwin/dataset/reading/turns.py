"""Turns of the sensors of a dataset as arrays, one row per frame, sensor and turn."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Literal, Self

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact.tables import columns_of
from urbantwin.dataset.reading.columns import POSE
from urbantwin.dataset.reading.tables import read_table, rows_by_name
from urbantwin.errors import InputError
from urbantwin.geometry import Pose

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["SensorTurns"]

FILE = "sweeps.parquet"
_EXPECTED = "the turns of the sensors of urbantwin record"


@dataclass(frozen=True, eq=False)
class SensorTurns:
    """Turns of sensors, in the order of the table.

    Attributes:
        frame: (R,) names of the frames.
        sensor: (R,) names of the sensors.
        lost: (R,) whether the turn was lost.
        true, reported: (R, 6) pose ``site_SE3_sensor`` at the start of the turn: x, y, z in metres,
            yaw, pitch, roll in radians.
    """

    frame: NDArray[np.object_]
    sensor: NDArray[np.object_]
    lost: NDArray[np.bool_]
    true: NDArray[np.float64]
    reported: NDArray[np.float64]

    @staticmethod
    def is_in(folder: Path) -> bool:
        """Return whether a folder has a table of turns."""
        return (folder / FILE).is_file()

    @classmethod
    def in_folder(cls, folder: Path) -> Self:
        """Read the turns of a dataset.

        Raises:
            InputError: missing or damaged.
        """
        return cls.of_table(read_table(folder / FILE), folder)

    @classmethod
    def of_table(cls, table: pa.Table, folder: Path) -> Self:
        """Return the rows of `Dataset.sweeps`; ``folder`` is for errors.

        Raises:
            InputError: a column is missing or of another type.
        """
        import pyarrow as pa

        file = folder / FILE
        text = columns_of(table, dict.fromkeys(("frame", "sensor"), "text"), file, _EXPECTED)
        lost = np.zeros(table.num_rows, np.bool_)
        if "lost" in table.column_names:
            if not pa.types.is_boolean(table["lost"].type):
                raise InputError(f"holds {table['lost'].type}", file=file, place="lost")
            lost = np.array([bool(value) for value in table["lost"].to_pylist()], np.bool_)
        poses = (
            np.column_stack([table[f"{kind}_{name}"].to_numpy() for name in POSE])
            for kind in ("true", "reported")
        )
        return cls(text["frame"], text["sensor"], lost, *poses)

    def of_frame(self, frame: str) -> NDArray[np.int64]:
        """Return the row numbers of the turns of a frame."""
        return self._rows.get(frame, np.zeros(0, np.int64))

    def first_poses(self, frame: str, kind: Literal["true", "reported"]) -> dict[str, Pose]:
        """Return the pose of each sensor at its first turn in a frame, by name."""
        poses = getattr(self, kind)
        pose_of: dict[str, Pose] = {}
        for row in self.of_frame(frame):
            if self.sensor[row] not in pose_of:
                pose_of[str(self.sensor[row])] = Pose.from_ypr(poses[row, :3], *poses[row, 3:])
        return pose_of

    @cached_property
    def lost_sensors(self) -> dict[str, frozenset[str]]:
        """Names of the sensors without any turn in a frame, by frame."""
        sensors = set(self.sensor.tolist())
        return {
            frame: frozenset(sensors - set(self.sensor[rows[~self.lost[rows]]].tolist()))
            for frame, rows in self._rows.items()
        }

    @cached_property
    def _rows(self) -> dict[str, NDArray[np.int64]]:
        return rows_by_name(self.frame)
