"""What the network should say of a sample: centres, their boxes, and what does not count."""

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

#: Standard deviation of a centre's surroundings over the root of its area in plan; at least, most.
_SPREAD, _LEAST_M, _MOST_M = 0.28, 0.35, 1.5
#: Cells whose value is this at least regress the box, too.
_REGRESSES = 0.4
#: What the cells that tell one object's box count together: about as much as those of a person and
#: of a car did in pillars of 0.4 m. Else boxes of buses drown centres, and in finer cells all do.
_BOX_COUNTS = 3.0
#: What is ignored is grown by this in plan, metres.
_IGNORED_MARGIN_M = 0.3
#: Points of a sample whose classes are asked for.
_MOST_ASKED = 8192


@dataclass(frozen=True, eq=False)
class ClassTarget:
    """What is to be said of one class in one grid.

    Attributes:
        heat: (rows, columns) float32: 1 where a centre is, less around it.
        counts: (rows, columns) float32: 0 where nothing said is wrong.
        cell: (P,) int64, the cells that regress a box.
        weight: (P,) float32, how much each of them counts; of each object as much altogether.
        box: (P, `heads.REGRESSED`) float32.
        objects: how many centres there are.
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
        classes: (B,) index into ``heads``; -1 for what is neither right nor wrong.
        grid: of the pillars.
        heads: the classes.
        counted: (cells, cells) where anything counts at all; everywhere if not given.
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
        counts[heat == 1] = 1.0  # whoever is known beside one who does not count
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
    """Which classes points of one grid have.

    Attributes:
        told: (K, 3 or 4) float32, see `pillars.told_of_points`.
        cell: (K,) int64.
        wanted: (K,) int64, index of the class.
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
    """Return what is to be said of some points whose classes are known and learned.

    Args:
        points: (N, 3 or 4) as `pillars.pillars_of` takes them.
        semantic: (N,) ids of their classes.
        grid: the cells.
        classes: ids that are learned, in their order.
        draw: random numbers.
    """
    index = np.full(256, -1, np.int64)
    index[list(classes)] = np.arange(len(classes))
    told, cell, inside = told_of_points(points, grid)
    wanted = index[semantic[inside]]
    known = np.flatnonzero(wanted >= 0)
    if len(known) > _MOST_ASKED:
        known = np.sort(draw.choice(known, _MOST_ASKED, replace=False))
    return PointTarget(told[known], cell[known], wanted[known])
