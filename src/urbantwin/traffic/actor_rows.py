"""Rows of the table of actors: postures and poses on the ground, in order of time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import shapely
from numpy.typing import NDArray

from urbantwin.traffic.assets import Asset
from urbantwin.traffic.demand.demand import Trip
from urbantwin.traffic.motion import step_times
from urbantwin.traffic.motion_rows import (
    ACTOR_SCHEMA,
    ActorRows,
    RowsInFile,
    RowsInMemory,
    write_rows,
)
from urbantwin.traffic.paths.apart import STANDING_MS
from urbantwin.traffic.paths.placement import Ground, stand
from urbantwin.traffic.paths.track_box import track_size

__all__ = ["KeptRows", "actor_rows"]

#: Number of rows renumbered at a time.
_ROWS_AT_ONCE = 1 << 16
_GOLDEN_RATIO = (5**0.5 - 1) / 2  # spreads the first gait phases of actors that depart together


def actor_rows(
    columns: dict[str, NDArray[Any]],
    trips: Sequence[Trip],
    lanes: tuple[str, ...],
    ground: Ground,
    *,
    step_s: float,
    asset: Callable[[str], Asset],
) -> tuple[pa.Table, NDArray[np.float64]]:
    """Return the rows of poses on the ground, and the positions (M, 2) of poses beside it.

    Poses beside the ground have no row.

    Args:
        columns: poses by trip and step, from step 0 on.
        trips: the trips; a row's track is the index of its trip.
        lanes: names of the lanes that ``columns["lane"]`` refers to.
        ground: ground that the actors are placed on.
        step_s: time between steps, seconds.
        asset: returns an asset's dimensions and contacts by name.
    """
    names = np.array([trip.asset for trip in trips], object)
    trip = columns["trip"]
    ceiling = ground.ceiling(columns["xy"], columns["lane"], lanes)
    z, pitch, roll = np.full((3, len(trip)), np.nan)
    phase = np.zeros(len(trip), np.int16)
    distinct, kind = np.unique(names.astype(str), return_inverse=True)
    for name in sorted(set(names[trip])):
        rows = np.flatnonzero(kind[trip] == np.searchsorted(distinct, name))
        mesh = asset(name)
        xy, yaw = columns["xy"][rows], columns["yaw"][rows]
        z[rows], pitch[rows], roll[rows] = stand(ground, mesh.supports, xy, yaw, ceiling[rows])
        moving = np.zeros(len(rows))
        if mesh.phases > 1:
            cycles = columns["distance"][rows] / mesh.stride_m + trip[rows] * _GOLDEN_RATIO
            moving = np.floor(cycles % 1.0 * mesh.phases).clip(0, mesh.phases - 1)
        phase[rows] = np.where(columns["speed"][rows] < STANDING_MS, mesh.standing, moving)
    order = np.lexsort([trip, columns["step"]])
    beside = columns["xy"][np.isnan(z)]
    order = order[~np.isnan(z[order])]
    trip = trip[order]
    driven, track = np.unique(trip, return_inverse=True)
    size = np.array([track_size(asset(names[number])) for number in driven]).reshape(-1, 3)[track]
    step = columns["step"][order]
    values = {
        "time_s": step_times(int(step.max(initial=0)) + 1, step_s)[step],
        "track": trip,
        "class": _text_column([trip.actor_class for trip in trips], trip),
        "asset": _text_column(names.tolist(), trip),
        "phase": phase[order],
        "x": columns["xy"][order, 0],
        "y": columns["xy"][order, 1],
        "z": z[order],
        "yaw": np.angle(np.exp(1j * columns["yaw"][order])),
        "pitch": pitch[order],
        "roll": roll[order],
        "length": size[:, 0],
        "width": size[:, 1],
        "height": size[:, 2],
        "speed": columns["speed"][order],
        "lane": _text_column(lanes, columns["lane"][order]),
    }
    arrays = [
        column
        if isinstance(column := values[field.name], pa.Array)
        else pa.array(column, field.type)
        for field in ACTOR_SCHEMA
    ]
    return pa.table(arrays, names=ACTOR_SCHEMA.names), beside


class KeptRows:
    """Rows of actors, stretch by stretch; on disk for long motions.

    Args:
        folder: folder of the rows; ``None`` keeps them in memory.
        region: the recorded region, site frame.
    """

    def __init__(self, folder: Path | None, region: shapely.Geometry) -> None:
        self._folder = folder
        self._region = region
        self._tables: list[pa.Table] = []
        self._files: list[Path] = []
        #: Number of poses that `stood` has processed.
        self.taken = 0

    def stood(
        self,
        columns: dict[str, NDArray[Any]],
        rows_of: Callable[[dict[str, NDArray[Any]]], tuple[pa.Table, NDArray[np.float64]]],
    ) -> int:
        """Add the rows of further poses; return the number of those in the region without ground.

        Outside the region the ground is narrow: the front of a turning bus leaves it.

        Args:
            columns: poses, as in `actor_rows`.
            rows_of: makes rows of poses: `actor_rows` with its other arguments bound.
        """
        left_out = 0
        for part in _some_steps(columns):
            rows, beside = rows_of(part)
            self.add(rows)
            left_out += int(shapely.contains_xy(self._region, beside).sum())
            self.taken += len(part["trip"])
        return left_out

    def add(self, rows: pa.Table) -> None:
        """Add further rows, as made by `actor_rows`."""
        if self._folder is None:
            self._tables.append(rows)
            return
        path = self._folder / f"rows-{len(self._files)}.arrow"
        with pa.ipc.new_file(str(path), rows.schema) as file:
            file.write_table(rows)
        self._files.append(path)

    def __iter__(self) -> Iterator[pa.Table]:
        """Yield the tables in the order in which they were added; may be called repeatedly."""
        yield from self._tables
        for path in self._files:
            with pa.OSFile(str(path)) as file:
                yield pa.ipc.open_file(file).read_all()

    def trips(self) -> NDArray[np.int32]:
        """Return the trip of each row (N,)."""
        parts = [rows["track"].to_numpy().astype(np.int32) for rows in self]
        return np.concatenate([np.zeros(0, np.int32), *parts])

    def rows(
        self,
        trip: NDArray[np.int32],
        kept: NDArray[np.bool_],
        number: NDArray[np.integer] | None,
        file: Path | None,
    ) -> ActorRows:
        """Return the selected rows (N,) as those of a motion.

        Args:
            trip: trip of each row.
            kept: mask of the rows to keep.
            number: track id of each trip; ``None`` numbers the trips that remain 1, 2, 3, ...
            file: file to write; ``None`` keeps the rows in memory.
        """
        if number is None:
            driven = np.unique(trip[kept])
            number = np.zeros(int(trip.max(initial=0)) + 1, np.int32)
            number[driven] = np.arange(len(driven)) + 1
        parts = self._numbered(number[trip], kept)
        if file is None:
            return RowsInMemory(pa.concat_tables([ACTOR_SCHEMA.empty_table(), *parts]))
        write_rows(parts, file)
        return RowsInFile(file)

    def _numbered(self, track: NDArray[np.integer], kept: NDArray[np.bool_]) -> Iterator[pa.Table]:
        """Yield the selected rows with their track ids, part by part."""
        begin = 0
        slices = (
            rows.slice(k, _ROWS_AT_ONCE)
            for rows in self
            for k in range(0, rows.num_rows, _ROWS_AT_ONCE)
        )
        for rows in slices:
            part_rows = slice(begin, begin + rows.num_rows)
            begin = part_rows.stop
            tracks = pa.array(track[part_rows], pa.int32())
            part = rows.set_column(rows.schema.get_field_index("track"), "track", tracks)
            if not kept[part_rows].all():
                part = part.filter(pa.array(kept[part_rows]))
            yield part.cast(ACTOR_SCHEMA)


def _some_steps(columns: dict[str, NDArray[Any]]) -> Iterator[dict[str, NDArray[Any]]]:
    """Yield the poses in groups of consecutive steps, to limit memory."""
    step = columns["step"]
    count = max(round(len(step) / _ROWS_AT_ONCE), 1)
    first = int(step.min(initial=0))
    ends = np.linspace(first, int(step.max(initial=0)) + 1, count + 1).astype(np.int64)
    for low, high in pairwise(ends.tolist()):
        rows = np.flatnonzero((step >= low) & (step < high))
        yield {name: values[rows] for name, values in columns.items()}


def _text_column(names: Sequence[str], index: NDArray[Any]) -> pa.Array:
    """Return ``names[index]`` as a column, without a Python object per row."""
    indices = pa.array(index.astype(np.int32))
    return pa.DictionaryArray.from_arrays(indices, pa.array(names, pa.string()))
