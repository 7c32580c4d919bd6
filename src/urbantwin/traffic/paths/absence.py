"""Actors that overlap others are left out for the visit.

Pedestrians step aside (`crowd`) and vehicles wait (`yielding`). An actor that overlaps another, or
something static, nevertheless is left out of the motion: from entering the region until leaving it
or, outside of the region, until entering it. So no actor vanishes in view of a sensor. Of two
overlapping actors the one with the lower cost is left out.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
import shapely
from numpy.typing import NDArray

from urbantwin.traffic.paths.kept_ways import some_actors
from urbantwin.traffic.paths.obstacles import Obstacles
from urbantwin.traffic.paths.overlap import Overlapping, rows_that_overlap, told_of

__all__ = ["NOBODY", "Absent", "Bystanders", "absent_from"]

#: Distance from the region within which an actor that enters it is on the same visit, metres: about
#: the length of long vehicles.
_NEAR_REGION_M = 20.0
#: Cost of leaving out an actor; 1 for other classes.
_COST_OF_ABSENCE = {"car": 2, "van": 2, "truck": 3, "trailer": 3, "bus": 4, "tram": 5}
#: Maximum number of visits listed individually.
_MAX_LISTED = 20
#: Conflicts within this distance are at one place, metres.
_SAME_PLACE_M = 5.0


@dataclass(frozen=True, eq=False)
class Bystanders:
    """Constraints of an event that others react to.

    Attributes:
        own: actors of the event, which are never left out.
        until: first step that may differ from the same traffic without the event.
        absent: (K, 2) actor and step of those left out without the event.
    """

    own: frozenset[int]
    until: int
    absent: NDArray[np.int64]


#: No event.
NOBODY = Bystanders(frozenset(), 0, np.zeros((0, 2), np.int64))


@dataclass(frozen=True, eq=False)
class Absent:
    """The actors that are left out.

    Attributes:
        rows: (N,) bool, mask of rows of the table of actors.
        steps: (K, 2) actor and step of the same.
        told: entry of `motion.json`: ``visits`` that are left out, and ``of`` how many; ``actors``,
            by class; ``with`` the other class or object, by both; ``most_at``: the place with most
            conflicts within 5 m, and their number; ``each``: class, begin, end, the other actor,
            time and place.
        left: remaining overlaps.
    """

    rows: NDArray[np.bool_]
    steps: NDArray[np.int64]
    told: dict[str, Any]
    left: Overlapping


def absent_from(
    actors: Iterable[pa.Table],
    whose: NDArray[np.integer],
    leads: NDArray[np.integer],
    parked: pa.Table,
    obstacles: Obstacles,
    region: shapely.Geometry,
    *,
    step_s: float,
    beside: Bystanders = NOBODY,
) -> Absent:
    """Return the visits to leave out so that no boxes overlap each other or the scene.

    Args:
        actors: rows of the motion by time and track, in parts of whole steps; iterated several
            times.
        whose: (N,) the vehicle that each row is a body of.
        leads: (N,) the same, with accompanying animals assigned to their owner.
        parked: the parked vehicles.
        obstacles: static obstacles.
        region: the recorded region.
        step_s: time between steps, seconds.
        beside: constraints of an event.
    """
    step, inside, is_near = _steps_and_region(actors, region, step_s)
    visit, begins, poses = _visits(whose, step, inside, is_near)
    overlapping = rows_that_overlap(actors, parked, step_s, obstacles, visit)
    pairs, hits = overlapping.pairs, overlapping.hits
    count = len(begins)
    first = _first_rows(visit, count)
    wanted = np.concatenate([first, pairs.ravel(), hits])
    rows, values = told_of(actors, wanted, ("class", "time_s", "x", "y"))
    kinds = values["class"][np.searchsorted(rows, first)]
    by_visit = np.zeros(count, np.int64)
    by_visit[visit] = whose
    staged = np.isin(by_visit, list(beside.own))
    stays = staged | (begins < beside.until)
    is_absent = np.zeros(count, np.bool_)
    early = np.flatnonzero(step < beside.until)
    is_absent[visit[early[_are_among(whose[early], step[early], beside.absent)]]] = True
    is_absent &= ~staged
    # Overlaps with static objects, or with own bodies, do not depend on other actors.
    alone = (pairs[:, 1] < 0) | (visit[pairs[:, 0]] == visit[np.maximum(pairs[:, 1], 0)])
    meets = visit[np.concatenate([hits, pairs[alone, 0]])]
    is_absent[meets] |= ~stays[meets]
    visit_pairs = visit[pairs[~alone]]
    cost = np.array([_COST_OF_ABSENCE.get(kind, 1) for kind in kinds])
    _choose_absent(visit_pairs, is_absent, stays, cost, poses)
    away = is_absent[visit]
    steps = np.unique(np.column_stack([whose[away], step[away]]).astype(np.int64), axis=0)
    led = np.flatnonzero(whose != leads)
    away[led] |= _are_among(leads[led], step[led], steps)
    why = _reasons(rows, values, overlapping, visit, is_absent)
    ends = np.zeros(count, np.int64)
    np.maximum.at(ends, visit, step)
    each = [
        {
            "class": kinds[number],
            "from_s": round(float(begins[number] * step_s), 3),
            "until_s": round(float(ends[number] * step_s), 3),
            **why.get(number, {}),
        }
        for number in np.flatnonzero(is_absent).tolist()
    ]
    counts = {
        "visits": len(each),
        "of": count,
        "actors": dict(sorted(Counter(str(x["class"]) for x in each).items())),
        "with": dict(
            sorted(Counter(f"{x['class']} and {x['with']}" for x in each if "with" in x).items())
        ),
        "most_at": _place_of_most(each),
        "each": each[:_MAX_LISTED],
    }
    return Absent(away, steps, counts, overlapping.among(~away))


def _steps_and_region(
    actors: Iterable[pa.Table], region: shapely.Geometry, step_s: float
) -> tuple[NDArray[np.int32], NDArray[np.bool_], NDArray[np.bool_]]:
    """Return the step of each row (N,), and whether it is in the region, or near it."""
    steps, inside, is_near = (
        [np.zeros(0, np.int32)],
        [np.zeros(0, np.bool_)],
        [np.zeros(0, np.bool_)],
    )
    for part in actors:
        steps.append(np.round(part["time_s"].to_numpy() / step_s).astype(np.int32))
        xy = np.column_stack([part["x"].to_numpy(), part["y"].to_numpy()])
        inside.append(_inside(xy, region))
        is_near.append(_inside(xy, region, _NEAR_REGION_M))
    return np.concatenate(steps), np.concatenate(inside), np.concatenate(is_near)


def _inside(
    xy: NDArray[np.float64], region: shapely.Geometry, beside_m: float = 0.0
) -> NDArray[np.bool_]:
    """Return which points (N, 2) are within a region, or within a distance of it."""
    wide = region.buffer(beside_m)
    shapely.prepare(wide)
    return np.asarray(shapely.contains_xy(wide, *xy.T), np.bool_)


def _visits(
    whose: NDArray[np.integer],
    step: NDArray[np.integer],
    inside: NDArray[np.bool_],
    near: NDArray[np.bool_],
) -> tuple[NDArray[np.int32], NDArray[np.int64], NDArray[np.int64]]:
    """Return the visit of each row (N,), the first step of each (V,), and its number of poses (V,).

    A visit is the time between entering and leaving the region. An actor near the region belongs to
    the visit that it enters before going farther away, or came from.
    """
    visit = np.empty(len(whose), np.int32)
    begins, poses, count = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)], 0
    for rows in some_actors(whose):  # to limit memory
        part_visits, begun = _visits_of(whose[rows], step[rows], inside[rows], near[rows])
        visit[rows] = part_visits + count
        count += len(begun)
        begins.append(begun.astype(np.int64))
        poses.append(np.bincount(part_visits, minlength=len(begun)))
    return visit, np.concatenate(begins), np.concatenate(poses)


def _visits_of(
    who: NDArray[np.integer],
    when: NDArray[np.integer],
    inside: NDArray[np.bool_],
    near: NDArray[np.bool_],
) -> tuple[NDArray[np.int64], NDArray[np.integer]]:
    """Return the visit of each row (N,), and the begin of each; rows are by actor and step."""
    new = np.concatenate([[True], (np.diff(who) != 0) | (np.diff(when) != 0)])[: len(who)]
    first = np.flatnonzero(new)
    who, when = who[first], when[first]
    # All bodies of an articulated vehicle count.
    within, beside = (np.logical_or.reduceat(flags, first) for flags in (inside, near))
    broken = np.concatenate([[True], (np.diff(who) != 0) | (np.diff(when) > 1)])
    runs = np.flatnonzero(broken | np.concatenate([[True], np.diff(beside)]))
    comes_in = np.logical_or.reduceat(within, runs)
    in_run = np.repeat(comes_in, np.diff(np.append(runs, len(first))))
    begun = broken | np.concatenate([[True], np.diff(in_run)])
    return (np.cumsum(begun) - 1)[np.cumsum(new) - 1], when[begun]


def _first_rows(visit: NDArray[np.integer], count: int) -> NDArray[np.int64]:
    """Return the first row of each visit (V,)."""
    first_row = np.zeros(count, np.int64)
    first_row[visit[::-1]] = np.arange(len(visit), dtype=np.int32)[::-1]
    return first_row


def _are_among(
    who: NDArray[np.integer], step: NDArray[np.integer], some: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Return which actors (N,) at steps (N,) are among some (K, 2)."""
    wide = np.int64(1) << 32
    return np.isin(who * wide + step, some[:, 0] * wide + some[:, 1])


def _choose_absent(
    met: NDArray[np.int64],
    gone: NDArray[np.bool_],
    stays: NDArray[np.bool_],
    cost: NDArray[np.int64],
    poses: NDArray[np.int64],
) -> None:
    """Mark the visits (V,) to leave out among overlapping pairs (P, 2), until none overlap.

    Greedy: repeatedly the one with the least cost per overlap; among equals the shortest. Visits
    without remaining overlaps are restored afterwards. Two that must both stay keep their overlap.
    """
    conflicts = {(a, b) for a, b in np.unique(np.sort(met, axis=1), axis=0).tolist()}
    conflicts = {
        (a, b) for a, b in conflicts if not (gone[a] or gone[b] or (stays[a] and stays[b]))
    }
    open_pairs, chosen = set(conflicts), []
    while open_pairs:
        times = Counter(visit for pair in open_pairs for visit in pair if not stays[visit])
        chosen.append(
            min(times, key=lambda visit: (cost[visit] / times[visit], poses[visit], visit))
        )
        gone[chosen[-1]] = True
        open_pairs = {pair for pair in open_pairs if chosen[-1] not in pair}
    for visit in sorted(chosen, key=lambda visit: (-cost[visit], -poses[visit], visit)):
        gone[visit] = any(visit in pair and not gone[sum(pair) - visit] for pair in conflicts)


def _place_of_most(each: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Return the place of most conflicts, x and y, and their number."""
    xy = np.array([(row["x"], row["y"]) for row in each if "x" in row]).reshape(-1, 2)
    if not len(xy):
        return {}
    is_near = np.linalg.norm(xy[:, None] - xy, axis=2) <= _SAME_PLACE_M
    best = int(is_near.sum(axis=1).argmax())
    x, y = xy[is_near[best]].mean(axis=0).round(1).tolist()
    return {"x": x, "y": y, "visits": int(is_near[best].sum())}


def _reasons(
    rows: NDArray[np.int64],
    told: dict[str, NDArray[Any]],
    overlapping: Overlapping,
    visit: NDArray[np.integer],
    gone: NDArray[np.bool_],
) -> dict[int, dict[str, Any]]:
    """Return the first overlap of each visit that is left out.

    Args:
        rows: rows with values (R,).
        told: their values.
        overlapping: rows that overlap.
        visit: visit of all rows.
        gone: mask of the visits that are left out.
    """
    first: dict[int, tuple[int, str]] = {}
    kinds = dict(zip(rows.tolist(), told["class"], strict=True))

    def note(row: int, other: str) -> None:
        number = int(visit[row])
        if gone[number] and row <= first.get(number, (row, ""))[0]:
            first[number] = row, other

    for row, name in zip(overlapping.hits.tolist(), overlapping.what.tolist(), strict=True):
        note(row, name)
    for first_row, second_row in overlapping.pairs.tolist():
        if second_row < 0:
            note(first_row, "parked")
        else:
            note(first_row, kinds[second_row])
            note(second_row, kinds[first_row])
    reasons = {}
    for number, (row, name) in first.items():
        index = np.searchsorted(rows, row)
        place = {axis: round(told[axis][index], 1) for axis in ("x", "y")}
        reasons[number] = {"with": name, "time_s": told["time_s"][index], **place}
    return reasons
