"""Stretches of time in which a long motion is resolved, each continuing from the last.

Conflicts are resolved with all poses of a period in memory (`crowd`, `separation`, `yielding`), at
hundreds of bytes per pose. So a long motion is processed in stretches. Each looks somewhat beyond
its end, and passes on the states of its last two steps: delays and lateral offsets. In the next
stretch actors continue from there, return to their paths and catch up as they would in one stretch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.traffic.paths.kept_ways import KeptWays
from urbantwin.traffic.paths.retiming import LIMITS, Pace, Way, curve_speeds, retimed
from urbantwin.traffic.paths.trajectory import steered

__all__ = ["WALKS", "LeftOff", "Stretch", "Ways", "far_at", "no_walks", "stretches"]

Columns = dict[str, NDArray[Any]]

#: Duration of a stretch, and look-ahead beyond its end, seconds: vehicles wait up to half a minute
#: before an encounter (`yielding`).
_STRETCH_S, _BEYOND_S = 240.0, 30.0
#: States of pedestrians besides poses: delay in rows, difference of the heading from that of the
#: path, number of steps held up, and number of steps of letting others pass.
WALKS = ("lag", "turn", "held", "let")
#: Number of rows of pedestrians' paths before their position that are included: back to the kerb.
_PEDESTRIAN_ROWS_BACK = 100
#: Distance within which a vehicle returns to its path, metres.
_RETURN_M = 12.0
#: Tolerances for equality, metres or rad, and rows.
_TOLERANCE, _ROW_TOLERANCE = 1e-6, 1e-6
#: Number of rows of a path before the position that are kept.
_VEHICLE_ROWS_BACK = 40
_KEY_FACTOR = np.int64(1) << 32


@dataclass(frozen=True)
class Stretch:
    """Steps that are resolved together.

    Attributes:
        begin: first step that is decided.
        end: step after the last that is decided.
        seen: step after the last that is considered.
    """

    begin: int
    end: int
    seen: int


def stretches(first: int, last: int, step_s: float) -> list[Stretch]:
    """Return the stretches of a range of steps.

    Args:
        first: the first step.
        last: the step after the last.
        step_s: time between steps, seconds.
    """
    long, beyond = round(_STRETCH_S / step_s), round(_BEYOND_S / step_s)
    count = max(round((last - first) / long), 1)
    begins = [first + n * long for n in range(count)]
    ends = [*begins[1:], last]
    return [Stretch(b, e, min(e + beyond, last)) for b, e in zip(begins, ends, strict=True)]


@dataclass(frozen=True, eq=False)
class LeftOff:
    """States of all actors in the last two steps of a stretch.

    Attributes:
        step: the step after them.
        columns: the poses of these steps by actor and step, with those of `WALKS`.
    """

    step: int
    columns: Columns

    @classmethod
    def of(cls, columns: Columns, step: int) -> LeftOff:
        """Return the states in the two steps before a step."""
        rows = np.flatnonzero((columns["step"] >= step - 2) & (columns["step"] < step))
        rows = rows[np.lexsort([columns["step"][rows], columns["trip"][rows]])]
        return cls(step, {name: values[rows] for name, values in columns.items()})

    def rows_among(
        self, columns: Columns, wanted: NDArray[np.bool_]
    ) -> tuple[NDArray[np.int64], Columns]:
        """Return which wanted rows (K,) of columns are in these steps, with their states."""
        rows = np.flatnonzero(wanted & (columns["step"] >= self.step - 2))
        rows = rows[columns["step"][rows] < self.step]
        place, is_present = self._places(columns["trip"][rows], columns["step"][rows])
        states = {name: values[place[is_present]] for name, values in self.columns.items()}
        return rows[is_present], states

    def of_actor(self, actor: int) -> Columns:
        """Return the poses of an actor, at most two."""
        low, high = np.searchsorted(self.columns["trip"], [actor, actor + 1])
        return {name: values[low:high] for name, values in self.columns.items()}

    def _places(
        self, trip: NDArray[np.integer], step: NDArray[np.integer]
    ) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        own_keys = self.columns["trip"] * _KEY_FACTOR + self.columns["step"]
        keys = trip * _KEY_FACTOR + step
        if not len(own_keys):
            return np.zeros(len(keys), np.int64), np.zeros(len(keys), np.bool_)
        place = np.minimum(np.searchsorted(own_keys, keys), len(own_keys) - 1)
        return place, own_keys[place] == keys


@dataclass(frozen=True)
class _Visit:
    """Consecutive rows of an actor's path.

    Attributes:
        low: first row.
        high: row after the last.
        begin: step of the first row.
        actor: the actor.
    """

    low: int
    high: int
    begin: int
    actor: int

    @property
    def end(self) -> int:
        """The step after the last."""
        return self.begin + self.high - self.low


class Ways:
    """Paths of all actors before conflicts are resolved.

    Args:
        ways: poses by actor and step: ``trip``, ``step``, ``xy``, ``yaw``, ``speed``, ``distance``,
            ``lane``.
        walks: (A,) whether each actor is a pedestrian.
        kinds: (A,) its class.
        vehicles: (A,) the vehicle that it is a body of.
        rear_m: (A,) distance of its rear axle behind its centre; 0 without one.
        step_s: time between steps, seconds.
    """

    def __init__(
        self,
        ways: KeptWays,
        walks: NDArray[np.bool_],
        kinds: Sequence[str],
        vehicles: NDArray[np.integer],
        rear_m: Sequence[float],
        step_s: float,
    ) -> None:
        self._kept, self.kinds, self.rear_m, self.step_s = ways.columns, kinds, rear_m, step_s
        columns = self._kept.opened()
        self._count = len(columns["trip"])
        trip, step = columns["trip"], columns["step"]
        new = np.concatenate([[True], (np.diff(trip) != 0) | (np.diff(step) != 1)])[: len(trip)]
        first = np.flatnonzero(new)
        last = np.append(first, len(trip))[1:]
        self._walked: list[_Visit] = []
        driven: dict[tuple[int, int, int], list[_Visit]] = {}
        for low, high in zip(first.tolist(), last.tolist(), strict=True):
            visit = _Visit(low, high, int(step[low]), int(trip[low]))
            if low < ways.since and visit.actor in ways.gone:
                continue
            if walks[visit.actor]:
                self._walked.append(visit)
            else:
                key = int(vehicles[visit.actor]), visit.begin, high - low
                driven.setdefault(key, []).append(visit)
        self._driven = list(driven.values())
        for group in self._driven:
            group.sort(key=lambda visit: visit.actor)

    def within(self, stretch: Stretch, left: LeftOff | None) -> Columns:
        """Return the paths of a stretch, continuing from the previous states.

        They have a further column: the displacement ``aside`` to the left of the path, metres.
        Paths of pedestrians begin somewhat before their position; those of vehicles with the last
        two steps of the previous stretch.
        """
        return self._first(stretch) if left is None else self._further(stretch, left)

    def _first(self, stretch: Stretch) -> Columns:
        """Return the paths until the end of the first stretch, in their order."""
        visits = self._walked + [visit for group in self._driven for visit in group]
        rows = [
            np.arange(visit.low, min(visit.high, visit.low + max(stretch.seen - visit.begin, 0)))
            for visit in sorted(visits, key=lambda visit: visit.low)
        ]
        return self._rows(np.concatenate(rows) if rows else np.zeros(0, np.int64))

    def _further(self, stretch: Stretch, left: LeftOff) -> Columns:
        """Return the paths of a stretch after the first."""
        rows, parts = [], []
        for visit in self._walked:
            if visit.begin >= stretch.seen or visit.end <= stretch.begin:
                continue
            lag = left.of_actor(visit.actor)["lag"]
            lag_rows = int(np.ceil(lag.max())) if len(lag) else 0
            since = max(stretch.begin - lag_rows - _PEDESTRIAN_ROWS_BACK, visit.begin)
            row_offset = visit.low - visit.begin
            rows.append(np.arange(row_offset + since, min(visit.high, row_offset + stretch.seen)))
        for group in self._driven:
            if group[0].begin < stretch.seen and group[0].end > stretch.begin:
                parts += self._driven_on(group, stretch, left)
        parts.append(self._rows(np.concatenate(rows) if rows else np.zeros(0, np.int64)))
        columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[-1]}
        order = np.lexsort([columns["step"], columns["trip"]])
        return {name: values[order] for name, values in columns.items()}

    def _rows(self, rows: NDArray[np.int64]) -> Columns:
        return self._kept.rows(rows) | {"aside": np.zeros(len(rows))}

    def _driven_on(self, group: list[_Visit], stretch: Stretch, left: LeftOff) -> list[Columns]:
        """Return the continuation of a vehicle's bodies."""
        begin = group[0].begin
        since = max(stretch.begin - 2, begin)
        until = min(stretch.seen, group[0].end)
        parts = [
            self._rows(np.arange(visit.low + since - begin, visit.low + until - begin))
            for visit in group
        ]
        if begin >= stretch.begin:
            return parts
        done = [left.of_actor(int(part["trip"][0])) for part in parts]
        whole = all(len(columns["step"]) == stretch.begin - since for columns in done)
        if not whole:
            return parts
        row, off, turned = self._where(group, stretch.begin - 1 - begin, done)
        late = stretch.begin - 1 - begin - row > _ROW_TOLERANCE
        if late or np.abs(off).max() > _TOLERANCE or np.abs(turned).max() > _TOLERANCE:
            low = max(int(row) - _VEHICLE_ROWS_BACK, 0)
            back = [
                self._back_on_its_way(
                    np.arange(visit.low + low, visit.low + until - begin), row - low, *how
                )
                for visit, *how in zip(group, off, turned, strict=True)
            ]
            path = self._catching_up(back[0], row - low, stretch.begin - begin - low, done[0])
            parts = [self._at(part, path, since - begin - low) for part in back]
        for part, columns in zip(parts, done, strict=True):
            for name, values in part.items():
                values[: len(columns["step"])] = columns[name]
        return parts

    def _where(
        self, group: list[_Visit], last: int, done: list[Columns]
    ) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
        """Return a vehicle's position on its path as a fractional row.

        Also the displacements of its bodies (B, 2) from their paths there, and their rotations
        (B,).
        """
        low = group[0].low
        distance_m, was = self._kept.span("distance", low, low + last + 1), done[0]["distance"][-1]
        row = max(int(np.searchsorted(distance_m, was + 1e-9, side="right")) - 1, 0)
        share = 0.0
        if row < last:
            share = float(
                np.clip((was - distance_m[row]) / (distance_m[row + 1] - distance_m[row]), 0.0, 1.0)
            )
        off, turned = np.zeros((len(group), 2)), np.zeros(len(group))
        for body, (visit, columns) in enumerate(zip(group, done, strict=True)):
            visit_row = visit.low + row
            for name, difference in (("xy", off), ("yaw", turned)):
                value, next_ = self._kept.span(name, visit_row, min(visit_row + 2, self._count))[
                    [0, -1]
                ]
                difference[body] = columns[name][-1] - (value + share * (next_ - value))
        return row + share, off, (turned + np.pi) % (2 * np.pi) - np.pi

    def _back_on_its_way(
        self, rows: NDArray[np.int64], row: float, off: NDArray[np.float64], turned: float
    ) -> Columns:
        """Return a body's path that leads from a displaced position at a fractional row back to it.

        Earlier points have the full displacement.
        """
        path = self._rows(rows)
        travelled_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path["xy"], axis=0).T))])
        beyond = travelled_m - np.interp(row, np.arange(len(travelled_m)), travelled_m)
        share = (1 + np.cos(np.pi * np.clip(beyond / _RETURN_M, 0.0, 1.0))) / 2
        path["xy"] = path["xy"] + off * share[:, None]
        path["yaw"] = path["yaw"] + turned * share
        left = np.column_stack([-np.sin(path["yaw"]), np.cos(path["yaw"])])
        path["aside"] = (left * off).sum(axis=1) * share
        rear_m = self.rear_m[int(path["trip"][0])]
        if rear_m > 0 and np.abs(off).max() > _TOLERANCE:
            first_row = int(np.ceil(row))
            path["yaw"][first_row:] = steered(
                path["xy"][first_row:], path["yaw"][first_row:], rear_m
            )
        return path

    def _catching_up(self, way: Columns, row: float, first: int, done: Columns) -> Way:
        """Return a vehicle's continuation from a fractional row of its path and a row in time."""
        moved = np.hypot(*np.diff(way["xy"], axis=0).T)
        own = np.concatenate([[0.0], np.cumsum(moved)])
        kind = self.kinds[int(way["trip"][0])]
        pace = Pace(own, curve_speeds(own, np.unwrap(way["yaw"]), self.step_s), self.step_s)
        station_m = own.copy()
        if kind in LIMITS:
            station_here = float(np.interp(row, np.arange(len(own)), own))
            station_m[:first] = station_here
            if len(done["step"]) > 1:
                station_m[: first - 1] = max(
                    station_here - float(np.hypot(*np.diff(done["xy"], axis=0)[0])), 0.0
                )
            station_m = retimed(pace, np.full(len(own), np.inf), LIMITS[kind], station_m, first)
        return Way(0, np.arange(len(own))[None], kind, pace, station_m, 0)

    def _at(self, way: Columns, at: Way, since: int) -> Columns:
        """Return the rows of a body's path from a row on, along the continuation."""
        place = at.at[since:]
        columns = {name: values[since:].copy() for name, values in way.items()}
        for name in ("xy", "yaw", "distance", "aside"):
            columns[name] = at.between(way[name], 0, place)
        columns["lane"] = way["lane"][np.round(at.row_at(place)).astype(int)]
        late = place < at.pace.at[since:] - _TOLERANCE
        columns["speed"][late] = np.gradient(at.at, self.step_s)[since:][late]
        return columns


def far_at(
    far: NDArray[np.float64], come: NDArray[np.float64], last: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return the values of a quantity of rows (N,) at fractional rows (K,).

    Args:
        far: (N,) values of the rows.
        come: (K,) fractional rows.
        last: (N,) the last row of the same actor.
    """
    low = come.astype(np.int64)
    high = np.minimum(low + 1, last[low])
    return np.asarray(far[low] + (come - low) * (far[high] - far[low]))


def no_walks(count: int) -> Columns:
    """Return the columns of `WALKS` for vehicles, or pedestrians exactly on their paths."""
    whole = {name: np.zeros(count, np.int64) for name in ("held", "let")}
    return {"lag": np.zeros(count), "turn": np.zeros(count), **whole}
