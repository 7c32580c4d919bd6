"""Overlaps: actors whose boxes pass through each other's, or through what stands in the scene."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
import pyarrow as pa
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import LabelledMesh
from urbantwin.traffic.paths.box_plan import PlanBoxes, near_pairs, rows_beside, shared_areas
from urbantwin.traffic.paths.coupling import are_coupled
from urbantwin.traffic.paths.obstacles import Obstacles

__all__ = ["OVERLAP_M2", "overlaps_of", "rows_that_overlap"]

#: Boxes overlap that share more than this in plan, square metres, on one level, metres.
OVERLAP_M2, LEVEL_M = 0.05, 2.0
#: What comes into an actor's box by less than this has touched it, metres.
TOUCH_M = 0.05
#: So many are told one by one.
_TOLD = 20
#: Rows that are looked at together.
_ROWS = 200_000
_COLUMNS = ("time_s", "track", "class", "asset", "x", "y", "z", "yaw", "length", "width", "height")
#: Two tracks -> how much they share at most, and what is told of it.
_Met = dict[tuple[int, int], tuple[float, dict[str, Any]]]


def overlaps_of(
    actors: pa.Table, parked: pa.Table, step_s: float, scene: LabelledMesh
) -> dict[str, Any]:
    """Return who overlaps whom or what at any step, each pair once.

    Args:
        actors: of a motion.
        parked: its parked vehicles, which stand at every step.
        step_s: time between its steps.
        scene: the static world.

    Returns:
        ``actors``: pairs of actors whose boxes share more than ``OVERLAP_M2`` in plan at any step,
        but for bodies of one vehicle; ``between``: the same by their classes. ``scene``: actors of
        whose box something static takes more than a touch, between knee and head; ``with``: the
        same by class and what it is.
        ``worst``: the pairs that share most, with when, where and how much. ``hits``: who meets
        something static, and what, when and where first.
    """
    still = _columns(parked)
    standing = _boxes(still, np.zeros(parked.num_rows, np.int64))
    tree, obstacles = shapely.STRtree(standing.polygons), Obstacles(scene)
    met: _Met = {}
    hits: dict[int, dict[str, Any]] = {}
    for _, part in _parts(actors):
        moving = _columns(part)
        boxes = _boxes(moving, np.round(moving["time_s"] / step_s).astype(np.int64))
        _note(met, _meetings(moving, boxes, still, standing, tree))
        for track, row in _scene_hits(moving, boxes, obstacles).items():
            hits.setdefault(track, row)
    worst = [row for _, row in sorted(met.items(), key=lambda one: (-one[1][0], one[0]))]
    kinds = Counter(" and ".join(sorted(row["classes"])) for _, row in worst)
    return {
        "actors": len(worst),
        "between": dict(sorted(kinds.items())),
        "scene": len(hits),
        "with": dict(
            sorted(Counter(f"{row['class']} and {row['with']}" for row in hits.values()).items())
        ),
        "worst": [row for _, row in worst[:_TOLD]],
        "hits": [hits[track] for track in sorted(hits)[:_TOLD]],
    }


def rows_that_overlap(
    actors: Iterable[pa.Table],
    parked: pa.Table,
    step_s: float,
    obstacles: Obstacles,
    who: NDArray[np.integer],
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.object_]]:
    """Return the rows of actors that `overlaps_of` counts.

    Args:
        actors: of a motion, part by part, each of whole steps.
        parked: its parked vehicles.
        step_s: time between its steps.
        obstacles: of the static world.
        who: (N,) of whom rows are: who stands still meets something static in one row at least.

    Returns:
        Pairs (P, 2), the second of which is -1 for a parked vehicle; rows (H,) that meet something
        static, and what (H,).
    """
    still = _columns(parked)
    standing = _boxes(still, np.zeros(parked.num_rows, np.int64))
    tree = shapely.STRtree(standing.polygons)
    none = np.zeros(0, np.int64)
    pairs, hits, names = [none.reshape(0, 2)], [none], [none.astype(object)]
    begin = 0
    for whole in actors:
        for number, part in _parts(whole):
            first = begin + number
            moving = _columns(part)
            boxes = _boxes(moving, np.round(moving["time_s"] / step_s).astype(np.int64))
            met, _, _ = _shared(moving, boxes, still, standing, tree)
            pairs.append(np.where(met < part.num_rows, met + first, -1))
            rows, what = _hit(moving, boxes, obstacles, who[first : first + part.num_rows])
            hits.append(rows + first)
            names.append(what)
        begin += whole.num_rows
    return np.concatenate(pairs), np.concatenate(hits), np.concatenate(names)


def _parts(actors: pa.Table) -> Iterator[tuple[int, pa.Table]]:
    """Yield the rows of whole steps, so many at a time that an hour does not take gigabytes.

    With the number of their first row.
    """
    time_s = actors["time_s"].to_numpy()
    first = 0
    while first < len(time_s):
        last = np.searchsorted(time_s, time_s[min(first + _ROWS, len(time_s)) - 1], side="right")
        yield first, actors.slice(first, int(last) - first)
        first = int(last)


def _columns(table: pa.Table) -> dict[str, NDArray[Any]]:
    return {name: table[name].to_numpy() for name in _COLUMNS}


def _boxes(columns: Mapping[str, NDArray[Any]], step: NDArray[np.int64]) -> PlanBoxes:
    half = np.column_stack([columns["length"], columns["width"]]) / 2
    return PlanBoxes(step, np.column_stack([columns["x"], columns["y"]]), columns["yaw"], half)


def _shared(
    moving: Mapping[str, NDArray[Any]],
    boxes: PlanBoxes,
    still: Mapping[str, NDArray[Any]],
    standing: PlanBoxes,
    tree: shapely.STRtree,
) -> tuple[NDArray[np.int64], NDArray[np.float64], dict[str, NDArray[Any]]]:
    """Return pairs (P, 2) of rows that overlap, how much they share (P,), and the columns.

    Rows of who stands follow after those of who moves.
    """
    beside, stands = rows_beside(tree, boxes, 0.0)
    first = len(boxes.yaw)
    pairs = np.concatenate(
        [near_pairs(boxes, 0.0), np.column_stack([beside, first + stands]).astype(np.int64)]
    )
    columns = {name: np.concatenate([moving[name], still[name]]) for name in _COLUMNS}
    pairs = pairs[np.abs(columns["z"][pairs[:, 0]] - columns["z"][pairs[:, 1]]) < LEVEL_M]
    area = shared_areas(PlanBoxes.joined([boxes, standing]), pairs)
    pairs, area = pairs[area > OVERLAP_M2], area[area > OVERLAP_M2]
    apart = ~are_coupled(columns, pairs)
    return pairs[apart], area[apart], columns


def _meetings(
    moving: Mapping[str, NDArray[Any]],
    boxes: PlanBoxes,
    still: Mapping[str, NDArray[Any]],
    standing: PlanBoxes,
    tree: shapely.STRtree,
) -> Iterator[tuple[float, dict[str, Any]]]:
    """Yield how much two share, and who, when and where, of each two that overlap at a step."""
    pairs, area, columns = _shared(moving, boxes, still, standing, tree)
    for rows, shared in zip(pairs, area.tolist(), strict=True):
        yield (
            shared,
            {
                "tracks": sorted(columns["track"][rows].tolist()),
                "classes": [str(columns["class"][row]) for row in sorted(rows.tolist())],
                "time_s": float(columns["time_s"][rows[0]]),
                "x": round(float(columns["x"][rows].mean()), 1),
                "y": round(float(columns["y"][rows].mean()), 1),
                "area_m2": round(shared, 2),
            },
        )


def _note(met: _Met, found: Iterable[tuple[float, dict[str, Any]]]) -> None:
    """Keep of each pair of tracks where it shares most."""
    for area, row in found:
        key = (row["tracks"][0], row["tracks"][1])
        if key not in met or area > met[key][0]:
            met[key] = (area, row)


def _scene_hits(
    columns: Mapping[str, NDArray[Any]], boxes: PlanBoxes, obstacles: Obstacles
) -> dict[int, dict[str, Any]]:
    """Return of each track that meets anything what it meets first, when and where."""
    hits: dict[int, dict[str, Any]] = {}
    for row, name in zip(*_hit(columns, boxes, obstacles, columns["track"]), strict=True):
        track = int(columns["track"][row])
        if track not in hits:
            hits[track] = {
                "track": track,
                "class": str(columns["class"][row]),
                "with": name,
                "time_s": float(columns["time_s"][row]),
                "x": round(float(columns["x"][row]), 1),
                "y": round(float(columns["y"][row]), 1),
            }
    return hits


def _hit(
    columns: Mapping[str, NDArray[Any]],
    boxes: PlanBoxes,
    obstacles: Obstacles,
    who: NDArray[np.integer],
) -> tuple[NDArray[np.int64], NDArray[np.object_]]:
    """Return the rows (H,) that meet something static, and what (H,)."""
    # Who stands where it stood before meets nothing new.
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
    met = np.array([bool(name) for name in what], np.bool_)
    return rows[met], what[met]
