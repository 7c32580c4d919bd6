"""Overlaps: actors whose boxes pass through each other's, or through what stands in the scene."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np
import pyarrow as pa
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import LabelledMesh
from urbantwin.traffic.paths.box_plan import PlanBoxes, near_pairs, rows_beside, shared_areas
from urbantwin.traffic.paths.coupling import are_coupled
from urbantwin.traffic.paths.obstacles import Obstacles

__all__ = ["OVERLAP_M2", "overlaps_of"]

#: Boxes overlap that share more than this in plan, square metres, on one level, metres.
OVERLAP_M2, LEVEL_M = 0.05, 2.0
#: What comes into an actor's box by less than this has touched it, metres.
TOUCH_M = 0.05
#: The worst are told one by one.
_TOLD = 20


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
        ``worst``: the pairs that share most, with when, where and how much.
    """
    columns = {
        name: np.concatenate([actors[name].to_numpy(), parked[name].to_numpy()])
        for name in (
            "time_s",
            "track",
            "class",
            "asset",
            "x",
            "y",
            "z",
            "yaw",
            "length",
            "width",
            "height",
        )
    }
    boxes = PlanBoxes(
        np.round(columns["time_s"] / step_s).astype(np.int64),
        np.column_stack([columns["x"], columns["y"]]),
        columns["yaw"],
        np.column_stack([columns["length"], columns["width"]]) / 2,
    )
    moving, still = np.split(np.arange(len(boxes.yaw)), [actors.num_rows])
    tree = shapely.STRtree(boxes.take(still).polygons)
    beside, stands = rows_beside(tree, boxes.take(moving), 0.0)
    pairs = np.concatenate(
        [near_pairs(boxes.take(moving), 0.0), np.column_stack([beside, still[stands]])]
    )
    pairs = pairs[np.abs(columns["z"][pairs[:, 0]] - columns["z"][pairs[:, 1]]) < LEVEL_M]
    pairs = pairs[~are_coupled(columns, pairs)]
    area = shared_areas(boxes, pairs)
    deep = area > OVERLAP_M2
    met = _worst(columns, pairs[deep], area[deep])
    kinds = Counter(" and ".join(sorted(one["classes"])) for one in met)
    hit = _scene_hits(
        {name: values[moving] for name, values in columns.items()},
        boxes.take(moving),
        Obstacles(scene),
    )
    return {
        "actors": len(met),
        "between": dict(sorted(kinds.items())),
        "scene": len(hit),
        "with": dict(sorted(Counter(hit.values()).items())),
        "worst": met[:_TOLD],
    }


def _worst(
    columns: Mapping[str, NDArray[Any]], pairs: NDArray[np.int64], area: NDArray[np.float64]
) -> list[dict[str, Any]]:
    """Return each pair of tracks once, where it shares most, the worst first."""
    found: dict[tuple[int, int], tuple[float, int]] = {}
    for k, (one, other) in enumerate(columns["track"][pairs].tolist()):
        key = (min(one, other), max(one, other))
        if area[k] > found.get(key, (0.0, 0))[0]:
            found[key] = (float(area[k]), k)
    order = sorted(found.items(), key=lambda item: (-item[1][0], item[0]))
    rows = [pairs[k] for _, (_, k) in order]
    return [
        {
            "tracks": list(key),
            "classes": [str(columns["class"][row]) for row in sorted(rows[n].tolist())],
            "time_s": float(columns["time_s"][rows[n][0]]),
            "x": round(float(columns["x"][rows[n]].mean()), 1),
            "y": round(float(columns["y"][rows[n]].mean()), 1),
            "area_m2": round(most, 2),
        }
        for n, (key, (most, _)) in enumerate(order)
    ]


def _scene_hits(
    columns: Mapping[str, NDArray[Any]], boxes: PlanBoxes, obstacles: Obstacles
) -> dict[int, str]:
    """Return of each track that meets anything its class and what it meets first."""
    # Who stands where somebody stood before meets nothing new.
    kept = np.round(np.column_stack([columns["track"], boxes.xy * 20, boxes.yaw * 50]))
    _, rows = np.unique(kept, axis=0, return_index=True)
    rows.sort()
    inner = PlanBoxes(
        boxes.step[rows],
        boxes.xy[rows],
        boxes.yaw[rows],
        np.maximum(boxes.half[rows] - TOUCH_M, 0.01),
    )
    what = obstacles.met(inner, columns["z"][rows], columns["height"][rows])
    hits: dict[int, str] = {}
    for row, name in zip(rows.tolist(), what, strict=True):
        if name:
            hits.setdefault(int(columns["track"][row]), f"{columns['class'][row]} and {name}")
    return hits
