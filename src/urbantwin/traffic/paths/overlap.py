"""Overlaps of actors' boxes with each other, or with the scene."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from urbantwin.geometry import LabelledMesh
from urbantwin.traffic.motion_rows import ActorRows, as_rows
from urbantwin.traffic.paths.box_plan import PlanBoxes, near_pairs, shared_areas
from urbantwin.traffic.paths.coupling import are_coupled
from urbantwin.traffic.paths.obstacles import Obstacles, Outlines

__all__ = [
    "OVERLAP_M2",
    "Overlapping",
    "overlaps_of",
    "overlaps_told",
    "rows_that_overlap",
    "told_of",
]

#: Shared area in plan, square metres, above which boxes overlap, and maximum difference of levels,
#: metres.
OVERLAP_M2, LEVEL_M = 0.05, 2.0
#: Overlap with the scene up to which an actor only touches it, metres.
TOUCH_M = 0.05
#: Maximum number of overlaps listed individually.
_MAX_LISTED = 20
#: Number of rows processed together.
_ROWS_AT_ONCE = 50_000
_COLUMNS = ("time_s", "asset", "x", "y", "z", "yaw", "length", "width", "height")


@dataclass(frozen=True, eq=False)
class Overlapping:
    """Rows of actors that overlap.

    Attributes:
        pairs: (P, 2) rows; the second is -1 - k for the k-th parked vehicle.
        area: (P,) shared area in plan, square metres.
        hits: (H,) rows that overlap something static, ascending.
        what: (H,) class of the static object.
    """

    pairs: NDArray[np.int64]
    area: NDArray[np.float64]
    hits: NDArray[np.int64]
    what: NDArray[np.object_]

    def among(self, kept: NDArray[np.bool_]) -> Overlapping:
        """Return the overlaps among some of the rows (N,), renumbered."""
        number = np.cumsum(kept) - 1
        is_static = self.pairs < 0
        both_kept = (kept[self.pairs] | is_static).all(axis=1)
        pairs = np.where(is_static, self.pairs, number[self.pairs])[both_kept]
        hit = kept[self.hits]
        return Overlapping(pairs, self.area[both_kept], number[self.hits[hit]], self.what[hit])


def overlaps_of(
    actors: pa.Table | ActorRows, parked: pa.Table, step_s: float, scene: LabelledMesh
) -> dict[str, Any]:
    """Return all overlaps of a motion, each pair once; see `overlaps_told`.

    Args:
        actors: rows of a motion.
        parked: its parked vehicles, which are there at every step.
        step_s: time between its steps, seconds.
        scene: the static world.
    """
    rows = as_rows(actors)
    track = np.asarray(rows["track"].to_numpy())
    overlaps = rows_that_overlap(rows.parts(), parked, step_s, Obstacles(scene), track)
    return overlaps_told(overlaps, rows.parts(), parked)


def overlaps_told(
    found: Overlapping, actors: Iterable[pa.Table], parked: pa.Table
) -> dict[str, Any]:
    """Return a report of overlaps, each pair once.

    Args:
        found: the rows that overlap.
        actors: the rows, part by part.
        parked: the parked vehicles.

    Returns:
        ``actors``: number of pairs whose boxes share more than ``OVERLAP_M2`` in plan at any step,
            except bodies of one vehicle; ``between``: the same by classes. ``scene``: number of
            actors whose box overlaps something static by more than a touch, between knee and head;
            ``with``: the same by class and object. ``worst``: the pairs with the largest shared
            area, with time and place. ``hits``: the first overlap of each actor with something
            static.
    """
    columns = ("track", "class", "time_s", "x", "y")
    rows, values = told_of(actors, np.concatenate([found.pairs.ravel(), found.hits]), columns)
    still = {name: np.array(parked[name].to_pylist(), object) for name in columns}

    def of(row: int, name: str) -> Any:  # noqa: ANN401 - of any column
        return still[name][-1 - row] if row < 0 else values[name][np.searchsorted(rows, row)]

    worst_of_pair: dict[tuple[int, int], tuple[float, dict[str, Any]]] = {}
    for pair, area in zip(found.pairs.tolist(), found.area.tolist(), strict=True):
        first, second = sorted(int(of(row, "track")) for row in pair)
        if (first, second) in worst_of_pair and area <= worst_of_pair[first, second][0]:
            continue
        in_order = sorted(pair, key=lambda row: (row < 0, row))
        middle = {axis: np.mean([of(row, axis) for row in pair]) for axis in ("x", "y")}
        worst_of_pair[first, second] = area, {
            "tracks": [first, second],
            "classes": [str(of(row, "class")) for row in in_order],
            "time_s": float(of(pair[0], "time_s")),
            **{axis: round(float(coordinate), 1) for axis, coordinate in middle.items()},
            "area_m2": round(area, 2),
        }  # fmt: skip
    worst = [
        row
        for _, (_, row) in sorted(worst_of_pair.items(), key=lambda entry: (-entry[1][0], entry[0]))
    ]
    kinds = Counter(" and ".join(sorted(row["classes"])) for row in worst)
    hits: dict[int, dict[str, Any]] = {}
    for row, name in zip(found.hits.tolist(), found.what.tolist(), strict=True):
        track = int(of(row, "track"))
        if track not in hits:
            hits[track] = {
                "track": track,
                "class": str(of(row, "class")),
                "with": name,
                "time_s": float(of(row, "time_s")),
                **{axis: round(float(of(row, axis)), 1) for axis in ("x", "y")},
            }
    return {
        "actors": len(worst),
        "between": dict(sorted(kinds.items())),
        "scene": len(hits),
        "with": dict(
            sorted(Counter(f"{row['class']} and {row['with']}" for row in hits.values()).items())
        ),
        "worst": worst[:_MAX_LISTED],
        "hits": [hits[track] for track in sorted(hits)[:_MAX_LISTED]],
    }


def rows_that_overlap(
    actors: Iterable[pa.Table],
    parked: pa.Table,
    step_s: float,
    obstacles: Obstacles,
    who: NDArray[np.integer],
) -> Overlapping:
    """Return the rows of actors that overlap others or the scene.

    Args:
        actors: rows of a motion, in parts of whole steps.
        parked: its parked vehicles.
        step_s: time between its steps, seconds.
        obstacles: static obstacles.
        who: (N,) actor of each row: a standing actor is tested against the scene only once.
    """
    still = _columns(parked)
    standing = _boxes(still, np.zeros(parked.num_rows, np.int64))
    outlines = Outlines(standing.polygons)
    none = np.zeros(0, np.int64)
    pairs, areas = [none.reshape(0, 2)], [np.zeros(0)]
    hits, names = [none], [none.astype(object)]
    begin = 0
    for whole in actors:
        for number, part in _parts(whole):
            first = begin + number
            moving = _columns(part)
            boxes = _boxes(moving, np.round(moving["time_s"] / step_s).astype(np.int64))
            pair_rows, area = _overlapping_pairs(moving, boxes, still, standing, outlines)
            pairs.append(
                np.where(
                    pair_rows < part.num_rows, pair_rows + first, part.num_rows - 1 - pair_rows
                )
            )
            areas.append(area)
            rows, what = _static_overlaps(
                moving, boxes, obstacles, who[first : first + part.num_rows]
            )
            hits.append(rows + first)
            names.append(what)
        begin += whole.num_rows
    return Overlapping(*(np.concatenate(parts) for parts in (pairs, areas, hits, names)))


def told_of(
    actors: Iterable[pa.Table], wanted: NDArray[np.int64], columns: Sequence[str]
) -> tuple[NDArray[np.int64], dict[str, NDArray[np.object_]]]:
    """Return the selected rows (R,), ascending, and their values in some columns.

    Args:
        actors: rows part by part.
        wanted: selected rows; negative ones are ignored.
        columns: names of the columns.
    """
    rows = np.unique(wanted[wanted >= 0])
    values_of: dict[str, list[NDArray[np.object_]]] = {name: [] for name in columns}
    begin = 0
    for part in actors if len(rows) else ():
        part_rows = rows[slice(*np.searchsorted(rows, [begin, begin + part.num_rows]))] - begin
        for name, values in values_of.items():
            values.append(np.array(part[name].take(pa.array(part_rows)).to_pylist(), object))
        begin += part.num_rows
    none = np.zeros(0, object)
    return rows, {name: np.concatenate([none, *values]) for name, values in values_of.items()}


def _parts(actors: pa.Table) -> Iterator[tuple[int, pa.Table]]:
    """Yield groups of whole steps, to limit memory.

    Each with the number of its first row.
    """
    time_s = actors["time_s"].to_numpy()
    first = 0
    while first < len(time_s):
        last = np.searchsorted(
            time_s, time_s[min(first + _ROWS_AT_ONCE, len(time_s)) - 1], side="right"
        )
        yield first, actors.slice(first, int(last) - first)
        first = int(last)


def _columns(table: pa.Table) -> dict[str, NDArray[Any]]:
    return {name: table[name].to_numpy() for name in _COLUMNS}


def _boxes(columns: Mapping[str, NDArray[Any]], step: NDArray[np.int64]) -> PlanBoxes:
    half = np.column_stack([columns["length"], columns["width"]]) / 2
    return PlanBoxes(step, np.column_stack([columns["x"], columns["y"]]), columns["yaw"], half)


def _overlapping_pairs(
    moving: Mapping[str, NDArray[Any]],
    boxes: PlanBoxes,
    still: Mapping[str, NDArray[Any]],
    standing: PlanBoxes,
    outlines: Outlines,
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return pairs (P, 2) of rows that overlap, and their shared area (P,).

    Rows of parked vehicles follow those of moving ones.
    """
    beside, standing_rows = outlines.beside(boxes)
    first = len(boxes.yaw)
    pairs = np.concatenate(
        [near_pairs(boxes, 0.0), np.column_stack([beside, first + standing_rows]).astype(np.int64)]
    )
    columns = {name: np.concatenate([moving[name], still[name]]) for name in _COLUMNS}
    pairs = pairs[np.abs(columns["z"][pairs[:, 0]] - columns["z"][pairs[:, 1]]) < LEVEL_M]
    area = shared_areas(PlanBoxes.joined([boxes, standing]), pairs)
    pairs, area = pairs[area > OVERLAP_M2], area[area > OVERLAP_M2]
    apart = ~are_coupled(columns, pairs)
    return pairs[apart], area[apart]


def _static_overlaps(
    columns: Mapping[str, NDArray[Any]],
    boxes: PlanBoxes,
    obstacles: Obstacles,
    who: NDArray[np.integer],
) -> tuple[NDArray[np.int64], NDArray[np.object_]]:
    """Return the rows (H,) that overlap something static, and its class (H,)."""
    # An unchanged pose needs no further test.
    by_who = np.argsort(who, kind="stable")
    place = np.round(np.column_stack([who, boxes.xy * 20, boxes.yaw * 50])[by_who])
    rows = np.sort(by_who[(np.diff(place, axis=0, prepend=np.nan) != 0).any(axis=1)])
    inner = PlanBoxes(
        boxes.step[rows],
        boxes.xy[rows],
        boxes.yaw[rows],
        np.maximum(boxes.half[rows] - TOUCH_M, 0.01),
    )
    what = np.array(obstacles.met(inner, columns["z"][rows], columns["height"][rows]), object)
    is_hit = np.array([bool(name) for name in what], np.bool_)
    return rows[is_hit], what[is_hit]
