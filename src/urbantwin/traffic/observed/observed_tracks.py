"""Reader of observations written by `write_observation`."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
from numpy.typing import NDArray
from pydantic import Field

from urbantwin.artefact import read_json
from urbantwin.artefact.manifest import Part, validated
from urbantwin.errors import InputError
from urbantwin.traffic.observed.frame_times import FrameTimes, evenly_spaced

__all__ = ["ObservedTracks", "is_observation", "read_observation"]

_EXPECTED = "a folder that `urbantwin traffic observe FRAMES --twin TWIN -o FOLDER` wrote"
_COLUMNS = ("class", "track_id", "time_s", "x", "y", "yaw_rad", "length", "width", "height")
#: Speed below which an actor stands, m/s.
_STANDING_M_S = 0.3


class _Observation(Part):
    frames: int
    rate_hz: float
    sensors: list[list[float]] = Field(default_factory=list)
    times_s: list[float] | None = None
    groups: list[int] | None = None


@dataclass(frozen=True, eq=False)
class ObservedTracks:
    """Observed actors, one row per actor and frame.

    Attributes:
        track: (N,) track ids.
        actor_class: (N,) names.
        time_s: (N,) seconds.
        xy: (N, 2) metres.
        yaw: (N,) radians.
        size: (N, 3) length, width and height of the box, metres.
        speed: (N,) m/s; ``nan`` if unknown.
        stands: (N,) whether it hardly moves.
        sensors: (S, 2) positions of the sensors; empty if unknown.
        once: (N,) whether it was seen once between gaps, so that its motion is unknown; ``None``
            without gaps.
    """

    track: NDArray[np.int64]
    actor_class: NDArray[np.object_]
    time_s: NDArray[np.float64]
    xy: NDArray[np.float64]
    yaw: NDArray[np.float64]
    size: NDArray[np.float64]
    speed: NDArray[np.float64]
    stands: NDArray[np.bool_]
    sensors: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 2)))
    once: NDArray[np.bool_] | None = None

    def only(self, rows: NDArray[np.bool_]) -> ObservedTracks:
        """Return some of the rows (N,)."""
        columns = {
            column.name: getattr(self, column.name)[rows]
            for column in fields(self)
            if column.name != "sensors" and getattr(self, column.name) is not None
        }
        return replace(self, **columns)


def is_observation(path: Path) -> bool:
    """Return whether a folder was written by ``urbantwin traffic observe``."""
    return (path / "observation.json").is_file()


def read_observation(folder: Path) -> tuple[ObservedTracks, FrameTimes]:
    """Return the observed tracks, and the times of the frames.

    Raises:
        InputError: it is no observation, or nothing was observed.
    """
    summary = validated(
        read_json(folder / "observation.json", kind="observation"),
        _Observation,
        file=folder / "observation.json",
        expected=_EXPECTED,
    )
    file = folder / "tracks.csv"
    try:
        table = pa_csv.read_csv(file)
        name, *rest = (table[column].to_numpy(zero_copy_only=False) for column in _COLUMNS)
        numbers = [side.astype(np.float64) for side in rest]
    except (OSError, KeyError, ValueError, pa.ArrowInvalid) as error:
        raise InputError("is no table of tracks", file=file, expected=_EXPECTED) from error
    if not len(name):
        raise InputError("has no track", file=file, expected="frames with a moving actor")
    order = np.lexsort((numbers[1], numbers[0]))
    track, time_s, x, y, yaw, *sides = (column[order] for column in numbers)
    name, xy = name[order], np.column_stack([x, y])
    # Speeds to the previous and next frame: an actor slow in either stands.
    both_speeds = np.full((2, len(track)), np.nan)
    same = np.flatnonzero(np.diff(track) == 0)
    along = np.linalg.norm(np.diff(xy, axis=0), axis=1)[same] / np.diff(time_s)[same]
    both_speeds[0, same], both_speeds[1, same + 1] = along, along
    slowest = np.fmin(*both_speeds)
    speed = np.where(np.isnan(both_speeds).any(axis=0), slowest, both_speeds.mean(axis=0))
    times = _times(summary, folder / "observation.json")
    once = np.isnan(speed) if times.gap.any() else None
    sensors = np.array(summary.sensors, np.float64).reshape(-1, 2)
    observed = ObservedTracks(
        track.astype(np.int64),
        name.astype(object),
        time_s,
        xy,
        yaw,
        np.column_stack(sides),
        speed,
        slowest < _STANDING_M_S,
        sensors,
        once,
    )
    return observed, times


def _times(told: _Observation, file: Path) -> FrameTimes:
    times = evenly_spaced(told.frames, told.rate_hz)
    if told.times_s is None or told.groups is None:
        return times
    time_s, group = np.array(told.times_s), np.array(told.groups)
    if (
        len(time_s) != told.frames
        or len(group) != told.frames
        or not (np.diff(time_s) > 0).all()
        or not np.isin(np.diff(group), (0, 1)).all()
    ):
        raise InputError("has not a time for each frame", file=file, expected=_EXPECTED)
    return FrameTimes(time_s, np.diff(group) > 0)
