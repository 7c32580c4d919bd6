"""Stretches of time: a long motion is parted one after the other, each going on from the last.

People and vehicles part by looking at all that happens (`crowd`, `separation`, `yielding`), which
takes hundreds of bytes for every pose. So a long motion is gone through in stretches. Each looks
somewhat beyond its end, as people and drivers do, and leaves behind where everybody is in its last
two steps: how late on its way, and how far beside it. In the next one everybody goes on from there,
comes back to its way and makes up for the time as it would in one stretch.
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

#: A stretch is so long, and looks so far beyond its end, seconds: who waits for somebody does so
#: up to half a minute before they meet (`yielding`).
_LONG_S, _BEYOND_S = 240.0, 30.0
#: What people are like besides their poses: by how many rows they are late, by how much their
#: heading differs from that of their way, for how many steps they were held up, and let others by.
WALKS = ("lag", "turn", "held", "let")
#: So many rows of people's ways are looked at before where they are: to the kerb that they left.
_BACK = 100
#: Who is beside its way comes back to it within so far, metres.
_BACK_M = 12.0
#: Less than this is no difference, metres or rad, and rows.
_SAME, _SAME_ROWS = 1e-6, 1e-6
#: So many rows of a way are kept before where somebody is.
_KEPT = 40
_WIDE = np.int64(1) << 32


@dataclass(frozen=True)
class Stretch:
    """Steps that are parted together.

    Attributes:
        begin: the first that is decided.
        end: the one after the last that is.
        seen: the one after the last that is looked at.
    """

    begin: int
    end: int
    seen: int


def stretches(first: int, last: int, step_s: float) -> list[Stretch]:
    """Return the stretches of the steps from one to another, which is not among them.

    Args:
        first: the first step.
        last: the step after the last.
        step_s: time between steps.
    """
    long, beyond = round(_LONG_S / step_s), round(_BEYOND_S / step_s)
    count = max(round((last - first) / long), 1)
    begins = [first + n * long for n in range(count)]
    ends = [*begins[1:], last]
    return [Stretch(b, e, min(e + beyond, last)) for b, e in zip(begins, ends, strict=True)]


@dataclass(frozen=True, eq=False)
class LeftOff:
    """Where everybody was in the last two steps of a stretch.

    Attributes:
        step: the step after them.
        columns: the poses of these steps by actor and step, with those of `WALKS`.
    """

    step: int
    columns: Columns

    @classmethod
    def of(cls, columns: Columns, step: int) -> LeftOff:
        """Return where everybody was in the two steps before a step."""
        rows = np.flatnonzero((columns["step"] >= step - 2) & (columns["step"] < step))
        rows = rows[np.lexsort([columns["step"][rows], columns["trip"][rows]])]
        return cls(step, {name: values[rows] for name, values in columns.items()})

    def rows_among(
        self, columns: Columns, wanted: NDArray[np.bool_]
    ) -> tuple[NDArray[np.int64], Columns]:
        """Return which rows (K,) of columns that are wanted are here, and what they were."""
        rows = np.flatnonzero(wanted & (columns["step"] >= self.step - 2))
        rows = rows[columns["step"][rows] < self.step]
        place, found = self._places(columns["trip"][rows], columns["step"][rows])
        there = {name: values[place[found]] for name, values in self.columns.items()}
        return rows[found], there

    def of_actor(self, actor: int) -> Columns:
        """Return the one or two poses of somebody, or none."""
        low, high = np.searchsorted(self.columns["trip"], [actor, actor + 1])
        return {name: values[low:high] for name, values in self.columns.items()}

    def _places(
        self, trip: NDArray[np.integer], step: NDArray[np.integer]
    ) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        mine = self.columns["trip"] * _WIDE + self.columns["step"]
        keys = trip * _WIDE + step
        if not len(mine):
            return np.zeros(len(keys), np.int64), np.zeros(len(keys), np.bool_)
        place = np.minimum(np.searchsorted(mine, keys), len(mine) - 1)
        return place, mine[place] == keys


@dataclass(frozen=True)
class _Visit:
    """Rows of somebody's way that follow each other in time.

    Attributes:
        low: the first of them.
        high: the one after the last.
        begin: the step of the first.
        actor: whose.
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
    """Everybody's way, as it was before anybody saw anybody.

    Args:
        ways: poses by actor and step: ``trip``, ``step``, ``xy``, ``yaw``, ``speed``, ``distance``,
            ``lane``.
        walks: (A,) of each actor whether it is on foot.
        kinds: (A,) its class.
        vehicles: (A,) the vehicle that it is a body of.
        rear_m: (A,) how far behind its middle its rear axle is; 0 without one.
        step_s: time between steps.
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
            one = _Visit(low, high, int(step[low]), int(trip[low]))
            if low < ways.since and one.actor in ways.gone:
                continue
            if walks[one.actor]:
                self._walked.append(one)
            else:
                key = int(vehicles[one.actor]), one.begin, high - low
                driven.setdefault(key, []).append(one)
        self._driven = list(driven.values())
        for group in self._driven:
            group.sort(key=lambda one: one.actor)

    def within(self, stretch: Stretch, left: LeftOff | None) -> Columns:
        """Return the ways of a stretch, as they go on from where everybody was.

        They have a further column: how far each is ``aside`` to the left of its way, metres.

        Of people they begin somewhat before where they are on their way; of who drives with the
        last two steps of the stretch before.
        """
        return self._first(stretch) if left is None else self._further(stretch, left)

    def _first(self, stretch: Stretch) -> Columns:
        """Return the ways until the end of the first stretch, in their order."""
        visits = self._walked + [visit for group in self._driven for visit in group]
        rows = [
            np.arange(one.low, min(one.high, one.low + max(stretch.seen - one.begin, 0)))
            for one in sorted(visits, key=lambda one: one.low)
        ]
        return self._rows(np.concatenate(rows) if rows else np.zeros(0, np.int64))

    def _further(self, stretch: Stretch, left: LeftOff) -> Columns:
        """Return the ways of a stretch after the first."""
        rows, parts = [], []
        for one in self._walked:
            if one.begin >= stretch.seen or one.end <= stretch.begin:
                continue
            lag = left.of_actor(one.actor)["lag"]
            behind = int(np.ceil(lag.max())) if len(lag) else 0
            since = max(stretch.begin - behind - _BACK, one.begin)
            way = one.low - one.begin
            rows.append(np.arange(way + since, min(one.high, way + stretch.seen)))
        for group in self._driven:
            if group[0].begin < stretch.seen and group[0].end > stretch.begin:
                parts += self._driven_on(group, stretch, left)
        parts.append(self._rows(np.concatenate(rows) if rows else np.zeros(0, np.int64)))
        found = {name: np.concatenate([one[name] for one in parts]) for name in parts[-1]}
        order = np.lexsort([found["step"], found["trip"]])
        return {name: values[order] for name, values in found.items()}

    def _rows(self, rows: NDArray[np.int64]) -> Columns:
        return self._kept.rows(rows) | {"aside": np.zeros(len(rows))}

    def _driven_on(self, group: list[_Visit], stretch: Stretch, left: LeftOff) -> list[Columns]:
        """Return how a vehicle's bodies go on from where they were."""
        begin = group[0].begin
        since = max(stretch.begin - 2, begin)
        until = min(stretch.seen, group[0].end)
        parts = [
            self._rows(np.arange(one.low + since - begin, one.low + until - begin)) for one in group
        ]
        if begin >= stretch.begin:
            return parts
        done = [left.of_actor(int(part["trip"][0])) for part in parts]
        whole = all(len(one["step"]) == stretch.begin - since for one in done)
        if not whole:
            return parts
        row, off, turned = self._where(group, stretch.begin - 1 - begin, done)
        late = stretch.begin - 1 - begin - row > _SAME_ROWS
        if late or np.abs(off).max() > _SAME or np.abs(turned).max() > _SAME:
            low = max(int(row) - _KEPT, 0)
            back = [
                self._back_on_its_way(
                    np.arange(one.low + low, one.low + until - begin), row - low, *how
                )
                for one, *how in zip(group, off, turned, strict=True)
            ]
            at = self._catching_up(back[0], row - low, stretch.begin - begin - low, done[0])
            parts = [self._at(one, at, since - begin - low) for one in back]
        for part, one in zip(parts, done, strict=True):
            for name, values in part.items():
                values[: len(one["step"])] = one[name]
        return parts

    def _where(
        self, group: list[_Visit], last: int, done: list[Columns]
    ) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
        """Return how far on its way a vehicle was in a row that is done, as a row, not whole.

        And how far its bodies (B, 2) were beside their ways there, and by how much they were
        turned (B,).
        """
        low = group[0].low
        went, was = self._kept.span("distance", low, low + last + 1), done[0]["distance"][-1]
        row = max(int(np.searchsorted(went, was + 1e-9, side="right")) - 1, 0)
        share = 0.0
        if row < last:
            share = float(np.clip((was - went[row]) / (went[row + 1] - went[row]), 0.0, 1.0))
        off, turned = np.zeros((len(group), 2)), np.zeros(len(group))
        for body, (visit, one) in enumerate(zip(group, done, strict=True)):
            at = visit.low + row
            for name, found in (("xy", off), ("yaw", turned)):
                here, next_ = self._kept.span(name, at, min(at + 2, self._count))[[0, -1]]
                found[body] = one[name][-1] - (here + share * (next_ - here))
        return row + share, off, (turned + np.pi) % (2 * np.pi) - np.pi

    def _back_on_its_way(
        self, rows: NDArray[np.int64], row: float, off: NDArray[np.float64], turned: float
    ) -> Columns:
        """Return rows of a body's way that leads from where it is, in a row not whole, back to it.

        What is before lies beside the way as far.
        """
        way = self._rows(rows)
        went = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(way["xy"], axis=0).T))])
        beyond = went - np.interp(row, np.arange(len(went)), went)
        share = (1 + np.cos(np.pi * np.clip(beyond / _BACK_M, 0.0, 1.0))) / 2
        way["xy"] = way["xy"] + off * share[:, None]
        way["yaw"] = way["yaw"] + turned * share
        left = np.column_stack([-np.sin(way["yaw"]), np.cos(way["yaw"])])
        way["aside"] = (left * off).sum(axis=1) * share
        rear_m = self.rear_m[int(way["trip"][0])]
        if rear_m > 0 and np.abs(off).max() > _SAME:
            here = int(np.ceil(row))
            way["yaw"][here:] = steered(way["xy"][here:], way["yaw"][here:], rear_m)
        return way

    def _catching_up(self, way: Columns, row: float, first: int, done: Columns) -> Way:
        """Return how somebody goes on, from a row of its way, not whole, and a row in time."""
        moved = np.hypot(*np.diff(way["xy"], axis=0).T)
        own = np.concatenate([[0.0], np.cumsum(moved)])
        kind = self.kinds[int(way["trip"][0])]
        pace = Pace(own, curve_speeds(own, np.unwrap(way["yaw"]), self.step_s), self.step_s)
        at = own.copy()
        if kind in LIMITS:
            here = float(np.interp(row, np.arange(len(own)), own))
            at[:first] = here
            if len(done["step"]) > 1:
                at[: first - 1] = max(here - float(np.hypot(*np.diff(done["xy"], axis=0)[0])), 0.0)
            at = retimed(pace, np.full(len(own), np.inf), LIMITS[kind], at, first)
        return Way(0, np.arange(len(own))[None], kind, pace, at, 0)

    def _at(self, way: Columns, at: Way, since: int) -> Columns:
        """Return the rows of a body's way, from one on, as somebody goes on along it."""
        place = at.at[since:]
        found = {name: values[since:].copy() for name, values in way.items()}
        for name in ("xy", "yaw", "distance", "aside"):
            found[name] = at.between(way[name], 0, place)
        found["lane"] = way["lane"][np.round(at.row_at(place)).astype(int)]
        late = place < at.pace.at[since:] - _SAME
        found["speed"][late] = np.gradient(at.at, self.step_s)[since:][late]
        return found


def far_at(
    far: NDArray[np.float64], come: NDArray[np.float64], last: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return what a quantity of rows (N,) is at rows that are not whole (K,).

    Args:
        far: (N,) of each row.
        come: (K,) the rows.
        last: (N,) the last row of the same actor.
    """
    low = come.astype(np.int64)
    high = np.minimum(low + 1, last[low])
    return np.asarray(far[low] + (come - low) * (far[high] - far[low]))


def no_walks(count: int) -> Columns:
    """Return the columns of `WALKS` of who is not on foot, or as its way has it."""
    whole = {name: np.zeros(count, np.int64) for name in ("held", "let")}
    return {"lag": np.zeros(count), "turn": np.zeros(count), **whole}
