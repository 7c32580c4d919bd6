"""Background subtraction: foreground and background of frames without labels."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from urbantwin.fidelity.frame import Frame
from urbantwin.reconstruct.recording import LEAST_FRAMES
from urbantwin.reconstruct.recording.still_ranges import COLUMNS, StillRanges, moves_as_nearest

__all__ = ["LEAST_FRAMES", "Background"]

#: Edge of the cells of directions, degrees.
_CELL_DEG = 0.4
#: Rings are those of a rotating sensor if elevations within a cell differ by less, degrees.
_LEVEL_DEG = 0.4


class Background:
    """The ranges of static surfaces by direction from a fixed sensor.

    Directions are those of ring and column if every frame has them, otherwise cells of 0.4 degrees
    of ring and azimuth or of elevation and azimuth. The static ranges of each direction are found
    by `range_modes`, which needs a return from beyond a waiting object. A car that is parked
    throughout is background, and so is one that waits from the first frame to the last.

    Args:
        frames: frames of a fixed sensor, in order of time and in one frame of reference.

    Raises:
        ValueError: fewer than ``LEAST_FRAMES`` frames.
    """

    def __init__(self, frames: Iterable[Frame]) -> None:
        known = list(frames)
        if len(known) < LEAST_FRAMES:
            raise ValueError(f"{len(known)} frames: at least {LEAST_FRAMES} are needed")
        self._columns = 0
        self._rings = all(one.ring is not None for one in known) and _turns(known[:2])
        columns = [int(one.column.max()) for one in known if one.column is not None]
        if self._rings and len(columns) == len(known):
            self._columns = 1 + max(columns)
        placed = [self._placed(one) for one in map(_on_beams, known)]
        cell, range_m = (np.concatenate(parts) for parts in zip(*placed, strict=True))
        number = np.repeat(np.arange(len(known)), [len(one) for one, _ in placed])
        self._still = StillRanges(
            cell,
            number,
            range_m,
            frames=len(known),
            turns=self._columns or round(360 / _CELL_DEG),
            rows_beside=0 if self._rings else 1,  # noise carries points across the edges of cells
        )

    def foreground(self, frame: Frame) -> NDArray[np.bool_]:
        """Return the mask (N,) of a frame's points that are not on static surfaces.

        Points beyond all static surfaces of their direction are background: those were hidden
        before. Points without a ring are classified as their nearest neighbours.
        """
        on = _on_beam(frame)
        some = frame if on.all() else frame.only(on)
        name, range_m = self._placed(some)
        moves = np.zeros(len(on), np.bool_)
        moves[on] = self._still.moving(name, range_m, some.points)
        moves_as_nearest(moves, frame.points, on)
        return moves

    def _placed(self, frame: Frame) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return cell and range (N,) of each point."""
        sensor, range_m, elevation, azimuth = _seen(frame)
        column = np.floor(azimuth / _CELL_DEG).astype(np.int64)
        if self._columns and frame.column is not None:
            column = frame.column
        row = np.floor((elevation + 90) / _CELL_DEG).astype(np.int64) + 1
        if self._rings and frame.ring is not None:
            row = frame.ring + 1
        return (sensor * COLUMNS + row) * COLUMNS + column, range_m


def _on_beam(frame: Frame) -> NDArray[np.bool_]:
    """Return the mask (N,) of points with a ring; all points if no point of the frame has one."""
    if frame.ring is None or not (frame.ring >= 0).any():
        return np.ones(len(frame.points), np.bool_)
    return np.asarray(frame.ring >= 0)


def _on_beams(frame: Frame) -> Frame:
    on = _on_beam(frame)
    return frame if on.all() else frame.only(on)


def _seen(
    frame: Frame,
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return sensor, range, elevation and azimuth (N,) of points from their sensors, in degrees."""
    sensor = np.zeros(len(frame.points), np.int64)
    if frame.sensor is not None and len(frame.sensor_places) > 1:
        sensor = frame.sensor.clip(0, len(frame.sensor_places) - 1)
    away = frame.points - frame.sensor_places[sensor]
    range_m: NDArray[np.float64] = np.linalg.norm(away, axis=1)
    up = np.degrees(np.arcsin(away[:, 2] / np.maximum(range_m, 1e-9)))
    around = np.degrees(np.arctan2(away[:, 1], away[:, 0])) % 360
    return sensor, range_m, up, around


def _turns(frames: list[Frame]) -> bool:
    """Return whether rings have constant elevations, unlike those of sensors with scan patterns."""
    names, elevations = [], []
    for frame in frames:
        sensor, _, up, around = _seen(frame)
        column = np.floor(around / _CELL_DEG).astype(np.int64)
        names.append((sensor * COLUMNS + np.asarray(frame.ring)) * COLUMNS + column)
        elevations.append(up)
    name, up = np.concatenate(names), np.concatenate(elevations)
    order = np.lexsort((up, name))
    same = np.diff(name[order]) == 0
    return bool(same.any() and np.percentile(np.diff(up[order])[same], 90) < _LEVEL_DEG)
