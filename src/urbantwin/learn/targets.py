"""Targets of a sample: heat maps of centres, encoded boxes, and the mask of the loss."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.learn.compiled.splat import drawn_centres, drawn_ignored
from urbantwin.learn.grid import Grid
from urbantwin.learn.heads import ClassHead, encoded
from urbantwin.learn.pillars import told_of_points

__all__ = ["ClassTarget", "PointTarget", "point_target_of", "targets_of"]

#: Standard deviation of a centre's heat over the square root of the box's area; lower and upper
#: bound, metres.
_SPREAD, _LEAST_M, _MOST_M = 0.28, 0.35, 1.5
#: Cells with at least this heat regress the box.
_REGRESSES = 0.4
#: Total weight of the cells that regress one box: about that of a person or a car in 0.4 m pillars.
#: Without it the loss of large boxes (or of fine cells) dominates that of centres.
_BOX_COUNTS = 3.0
#: Margin of ignored boxes in plan, metres.
_IGNORED_MARGIN_M = 0.3
#: Largest number of point targets in a sample.
_MOST_ASKED = 8192


@dataclass(frozen=True, eq=False)
class ClassTarget:
    """Target of one class on one grid.

    Attributes:
        heat: (rows, columns) float32: 1 at a centre, less around it.
        counts: (rows, columns) float32: weight of the loss; 0 in ignored cells.
        cell: (P,) int64: cells that regress a box.
        weight: (P,) float32: weight of each of them; the sum is the same for every object.
        box: (P, `heads.REGRESSED`) float32: encoded boxes.
        objects: number of centres.
    """

    heat: NDArray[np.float32]
    counts: NDArray[np.float32]
    cell: NDArray[np.int64]
    weight: NDArray[np.float32]
    box: NDArray[np.float32]
    objects: int


def targets_of(
    boxes: NDArray[np.float64],
    classes: NDArray[np.int64],
    grid: Grid,
    heads: Sequence[ClassHead],
    counted: NDArray[np.bool_] | None = None,
) -> list[ClassTarget]:
    """Return the targets of each class.

    Args:
        boxes: (B, 7), z above the ground.
        classes: (B,) index into ``heads``; -1 for ignored boxes.
        grid: grid of the pillars.
        heads: heads of the classes.
        counted: (cells, cells) labelled area; all cells if not given.
    """
    found = []
    for number, head in enumerate(heads):
        cells = grid.coarser(head.stride)
        shape = (cells.cells, cells.cells)
        heat, counts = np.zeros(shape, np.float32), np.ones(shape, np.float32)
        drawn_ignored(counts, boxes[classes < 0], cells.low, cells.cell_m, _IGNORED_MARGIN_M)
        mine = boxes[classes == number]
        spread = _SPREAD * np.sqrt(mine[:, 3] * mine[:, 4])
        cell, whose, weight = drawn_centres(
            heat,
            mine[:, 0] - cells.x,
            mine[:, 1] - cells.y,
            np.clip(spread, _LEAST_M, _MOST_M),
            cells.cell_m,
            _REGRESSES,
        )
        weight = weight * _BOX_COUNTS / np.bincount(whose, weight)[whose]
        counts[heat == 1] = 1.0  # a known object beside an ignored one
        if counted is not None:
            step = head.stride
            counts *= counted[step // 2 :: step, step // 2 :: step]
            weight = weight * counts.ravel()[cell]
        told = encoded(mine[whose], cells.middles(cell), cells.cell_m, head)
        objects = int(((heat == 1) & (counts > 0)).sum())
        found.append(ClassTarget(heat, counts, cell, weight.astype(np.float32), told, objects))
    return found


@dataclass(frozen=True, eq=False)
class PointTarget:
    """Classes of points on one grid.

    Attributes:
        told: (K, 3 or 4) float32: features, see `pillars.told_of_points`.
        cell: (K,) int64: cells.
        wanted: (K,) int64: class indices.
    """

    told: NDArray[np.float32]
    cell: NDArray[np.int64]
    wanted: NDArray[np.int64]


def point_target_of(
    points: NDArray[np.float32],
    semantic: NDArray[np.uint8],
    grid: Grid,
    classes: Sequence[int],
    draw: np.random.Generator,
) -> PointTarget:
    """Return the targets of a random selection of points with a class to learn.

    Args:
        points: (N, 3 or 4) as `pillars.pillars_of` takes them.
        semantic: (N,) semantic ids.
        grid: grid of the pillars.
        classes: semantic ids to learn, in order.
        draw: random generator.
    """
    index = np.full(256, -1, np.int64)
    index[list(classes)] = np.arange(len(classes))
    told, cell, inside = told_of_points(points, grid)
    wanted = index[semantic[inside]]
    known = np.flatnonzero(wanted >= 0)
    if len(known) > _MOST_ASKED:
        known = np.sort(draw.choice(known, _MOST_ASKED, replace=False))
    return PointTarget(told[known], cell[known], wanted[known])
