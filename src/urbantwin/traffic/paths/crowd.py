"""Crowd: people on their ways step aside and wait, so that nobody walks through anybody.

SUMO's walkers meet on walking areas without seeing each other, stand closer than they are wide and
squeeze past. So each goes its way anew, step by step in time, as people do: it looks two seconds
ahead and goes a little to the side early of whom it would come into, is pushed apart from whom it
touches (position based dynamics: Mueller et al., Journal of Visual Communication and Image
Representation 18, 2007), comes back to its way, and stays where it is if it would lie in somebody
even so. Who was held up hurries a little. As nobody lies in anybody at first, nobody does later:
what is left are vehicles that drive into somebody, and those wait (`yielding`). Nobody foresees
more than two seconds, so what changes later changes nothing before.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, maximum_filter1d

from urbantwin.traffic.compiled.asides import BESIDE_M
from urbantwin.traffic.compiled.crowd import FASTEST_MS, MOST_M, walked
from urbantwin.traffic.paths.box_plan import PlanBoxes
from urbantwin.traffic.paths.footing import BODY_M
from urbantwin.traffic.paths.kerbs import NO_CROSSINGS, Crossings
from urbantwin.traffic.paths.parting import Moving
from urbantwin.traffic.paths.solids import ROOM_M
from urbantwin.traffic.paths.walked_cells import WalkedCells

__all__ = ["crowd_walked"]

#: What stands is looked up in cells of this size, metres.
_STILL_CELL_M = 2.0
#: How fast people walk is looked at over so long before and after, seconds.
_PACE_S = 5.0
#: Who has little room keeps so far from what stands, metres, from the middle.
_TIGHT_M = 0.1


def crowd_walked(  # noqa: PLR0913 - all that they go between
    columns: dict[str, NDArray[Any]],
    moving: Moving,
    half: NDArray[np.float64],
    step_s: float,
    blocks: PlanBoxes,
    solids: NDArray[np.object_],
    footway: shapely.Geometry,
    *,
    crossings: Crossings = NO_CROSSINGS,
    patience_s: tuple[float, float] = (15.0, 4.0),
) -> dict[str, NDArray[Any]]:
    """Return poses in which people step aside and wait for whomever they would come into.

    Whoever comes into nobody keeps its path to the bit.

    Args:
        columns: poses by actor and step: ``step``, ``xy``, ``yaw``, ``speed``, ``distance``,
            ``lane``.
        moving: who they are, on which level, and whose bodies.
        half: (N, 2) half the sizes that nobody is to come into, metres.
        step_s: time between steps.
        blocks: what stands on the ground.
        solids: outlines of what stands in people's way.
        footway: who is on it stays there.
        crossings: at which who is late waits.
        patience_s: how long for vehicles that come, without a signal, and at green.
    """
    step, xy = columns["step"].astype(np.int64), columns["xy"]
    people = np.array([name == "pedestrian" for name in moving.classes], np.bool_)[moving.actor]
    if not people.any():
        return columns
    joined = np.concatenate([[False], (np.diff(moving.actor) == 0) & (np.diff(step) == 1)])
    first = np.flatnonzero(~joined)
    last = np.append(first[1:] - 1, len(step) - 1)[np.cumsum(~joined) - 1]
    went = np.where(joined, np.hypot(*np.diff(xy, axis=0, prepend=xy[:1]).T), 0.0)
    far = np.cumsum(went)
    far -= far[first][np.cumsum(~joined) - 1]
    boxes = np.column_stack([xy, np.cos(columns["yaw"]), np.sin(columns["yaw"]), half])
    standing = np.column_stack([blocks.xy, np.cos(blocks.yaw), np.sin(blocks.yaw), blocks.half])
    inner = shapely.buffer(solids, _TIGHT_M - ROOM_M)
    beside_road = shapely.buffer(footway, -BODY_M)
    shapely.prepare(beside_road)
    cells = WalkedCells(xy[people], inner, footway, MOST_M + 1.0)
    steps = np.arange(step.min(), step.max() + 2)
    rows, others = (_by_step(step, who) for who in (people, ~people))
    place, come = walked(
        np.searchsorted(step[rows], steps), rows, np.searchsorted(step[others], steps), others,
        np.concatenate([boxes, standing]), moving.actor.astype(np.int64),
        moving.level.astype(np.int64), far,
        _pace(went / step_s, first, round(_PACE_S / step_s)), joined, last,
        crossings.kerbs(
            columns["lane"], joined, last,
            lambda some: shapely.contains_xy(beside_road, *xy[some].T),
        ), crossings.green,
        np.round(np.array(patience_s) / step_s).astype(np.int64),
        *_still_cells(xy[people], blocks), cells.cells, cells.corner, step_s,
    )  # fmt: skip
    yaw = columns["yaw"]
    low = come.astype(np.int64)
    changed = people & (
        (place[:, :2] != xy).any(axis=1) | (place[:, 2] != 0) | (come != np.arange(len(come)))
    )
    place[~people, :2] = xy[~people]
    found = {name: values.copy() for name, values in columns.items()}
    found["xy"] = place[:, :2].copy()
    found["yaw"][changed] = (yaw[low] + place[:, 2])[changed]
    found["lane"][changed] = columns["lane"][low][changed]
    rest = come - low
    high = np.minimum(low + 1, last)
    distance = columns["distance"]
    between = distance[low] + rest * (distance[high] - distance[low])
    found["distance"][changed] = between[changed]
    # The speed is SUMO's, and what the change adds to it.
    now = np.where(joined, np.hypot(*np.diff(place[:, :2], axis=0, prepend=place[:1, :2]).T), 0.0)
    other = changed & joined
    found["speed"][other] = (now / step_s)[other]
    return found


def _by_step(step: NDArray[np.int64], wanted: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the rows that are wanted, by step."""
    rows = np.flatnonzero(wanted)
    return rows[np.argsort(step[rows], kind="stable")]


def _pace(speed: NDArray[np.float64], first: NDArray[np.int64], reach: int) -> NDArray[np.float64]:
    """Return how fast each goes about every row (N,), m/s, part by part of its way."""
    parts = np.split(np.minimum(speed, FASTEST_MS), first[1:])
    return np.concatenate([maximum_filter1d(one, 2 * reach + 1, mode="nearest") for one in parts])


def _still_cells(
    xy: NDArray[np.float64], blocks: PlanBoxes
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Return what stands near each cell where people walk, see ``compiled.crowd.walked``."""
    low = xy.min(axis=0) - 2 * _STILL_CELL_M
    cell = ((xy - low) / _STILL_CELL_M).astype(np.int64)
    shape = cell.max(axis=0) + 3
    used = np.zeros(shape[::-1], np.bool_)
    used[cell[:, 1], cell[:, 0]] = True
    row, column = np.nonzero(binary_dilation(used, np.ones((3, 3), np.bool_)))
    west, south = low[0] + column * _STILL_CELL_M, low[1] + row * _STILL_CELL_M
    squares = shapely.box(west, south, west + _STILL_CELL_M, south + _STILL_CELL_M)
    tree = shapely.STRtree(blocks.polygons)
    which, block = tree.query(squares, predicate="dwithin", distance=BESIDE_M)
    order = np.lexsort([block, which])
    counts = np.zeros(int(shape.prod()) + 1, np.int64)
    number = row * shape[0] + column
    np.add.at(counts, number[which] + 1, 1)
    # Cells are numbered by row, and so are the squares.
    return (
        np.cumsum(counts),
        block[order].astype(np.int64),
        np.array([*low, _STILL_CELL_M, *shape], np.float64),
    )
