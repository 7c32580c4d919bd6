"""Sidestepping: people in a crowd part step by step, where smooth paths that part were not found.

`separation` bends whole paths at once, and where many meet for long (at a refuge, say) it does not
come to an end: who passes on which side of whom changes with every round. What is left of it is
parted forward in time, as people do: who would come into somebody soon goes a little to the side
early, who touches somebody is pushed apart (position based dynamics: Mueller et al., Journal of
Visual Communication and Image Representation 18, 2007), and who walks on comes back to its way.
Nobody foresees more than two seconds, so what changes later changes nothing before.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from affine import Affine
from numpy.typing import NDArray
from rasterio.features import rasterize

from urbantwin.traffic.compiled.sidesteps import sidesteps
from urbantwin.traffic.paths.box_plan import PlanBoxes, rows_beside
from urbantwin.traffic.paths.parting import Moving

__all__ = ["sidestepped"]

#: Who comes so near in plan is looked at, metres.
_NEAR_M = 4.0
#: The same of what stands.
_BESIDE_M = 1.5
#: Where nobody walks is looked at in cells of this size, metres.
_CELL_M = 0.2


def sidestepped(
    columns: dict[str, NDArray[Any]],
    moving: Moving,
    half: NDArray[np.float64],
    step_s: float,
    blocks: PlanBoxes,
    solids: NDArray[np.object_],
    footway: shapely.Geometry,
) -> dict[str, NDArray[Any]]:
    """Return poses in which people stepped aside for whomever they would come into.

    Whoever comes into nobody keeps its path to the bit.

    Args:
        columns: poses by actor and step: ``step``, ``xy``, ``yaw``, ``speed``.
        moving: who they are, on which level, and whose bodies.
        half: (N, 2) half the sizes that nobody is to come into, metres.
        step_s: time between steps.
        blocks: what stands on the ground.
        solids: outlines of what stands in people's way.
        footway: who is on it stays there.
    """
    step, xy = columns["step"].astype(np.int64), columns["xy"]
    people = np.array([name == "pedestrian" for name in moving.classes], np.bool_)[moving.actor]
    if not people.any():
        return columns
    boxes = PlanBoxes(step, xy, columns["yaw"], half)
    pairs = Moving(
        moving.actor, boxes, columns["speed"], moving.level, moving.lane, moving.classes,
        moving.vehicles,
    ).pairs(_NEAR_M, xy, people)  # fmt: skip
    # Who moves comes first in a pair of somebody and something.
    pairs = np.where(people[pairs[:, :1]], pairs, pairs[:, ::-1])
    walks = np.flatnonzero(people & (moving.level == 0))
    row, block = rows_beside(shapely.STRtree(blocks.polygons), boxes.take(walks), _BESIDE_M)
    pairs = np.concatenate([pairs, np.column_stack([walks[row], block + len(step)])])
    pairs = pairs[np.argsort(step[pairs[:, 0]], kind="stable")]
    rows = np.flatnonzero(people)
    rows = rows[np.argsort(step[rows], kind="stable")]
    steps = np.arange(step.min(), step.max() + 2)
    joined = np.concatenate([[False], (np.diff(moving.actor) == 0) & (np.diff(step) == 1)])
    last = np.append(np.flatnonzero(~joined)[1:] - 1, len(step) - 1)[np.cumsum(~joined) - 1]
    both = PlanBoxes.joined([boxes, blocks])
    heading = np.column_stack([np.cos(both.yaw), np.sin(both.yaw)])
    cells, corner = _cells(xy[rows], solids, footway)
    aside = sidesteps(
        np.searchsorted(step[rows], steps), rows,
        np.searchsorted(step[pairs[:, 0]], steps), pairs,
        np.hstack([both.xy, heading, both.half]), joined, last,
        np.append(people, np.zeros(len(blocks.yaw), np.bool_)), cells, corner, step_s,
    )  # fmt: skip
    aside, heading = aside[: len(step)], heading[: len(step)]
    change = np.zeros_like(aside)
    change[1:][joined[1:]] = np.diff(aside, axis=0)[joined[1:]] / step_s
    speed = np.maximum(columns["speed"] + (change * heading).sum(axis=1), 0.0)
    return {**columns, "xy": xy + aside, "speed": speed}


def _cells(
    xy: NDArray[np.float64], solids: NDArray[np.object_], footway: shapely.Geometry
) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
    """Return where nobody walks, row by row from the south, and where the cells begin."""
    low, high = xy.min(axis=0) - 2.0, xy.max(axis=0) + 2.0
    shape = tuple(int(n) for n in np.ceil((high - low) / _CELL_M)[::-1])
    # Rows go from the south to the north here: the raster's are turned.
    grid = Affine(_CELL_M, 0.0, low[0], 0.0, -_CELL_M, low[1] + shape[0] * _CELL_M)
    cells = np.full(shape, 2, np.uint8)
    if not footway.is_empty:
        cells = rasterize([(footway, 0)], shape, fill=2, transform=grid, dtype=np.uint8)
    if len(solids):
        made = rasterize([(one, 1) for one in solids], shape, transform=grid, dtype=np.uint8)
        cells = np.where(made > 0, made, cells)
    return np.ascontiguousarray(cells[::-1]), np.array([*low, _CELL_M])
