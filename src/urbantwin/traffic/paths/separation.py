"""Separation: ways of vehicles bent a little, where somebody or something is beside them.

SUMO's vehicles know of lanes, not of the shapes that lanes take where they meet, nor of who stands
at the kerb. So their ways are changed after the simulation, as little and as smoothly as it takes.
Each one's displacement minimises

    sum over time of  |d|^2 + s^4 |d''|^2  (+ very stiff d' while it stands),

with s the time within which it changes, under one constraint for each two boxes that come near
each other at a step: they are apart along one direction. It is solved by the alternating direction
method of multipliers (Boyd et al., Foundations and Trends in Machine Learning 3, 2011; for contacts
of moving bodies Overby et al., IEEE TVCG 23, 2017): the paths are banded systems, the pairs are
projections, one formula each.

Who drives goes aside as far as its lane allows; the heavier, the less. People see to themselves
(`crowd`). Where somebody has to wait, `yielding` finds who.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from urbantwin.progress import Progress, between, each, untold
from urbantwin.traffic.paths.box_plan import meetings
from urbantwin.traffic.paths.obstacles import Blocks
from urbantwin.traffic.paths.parting import (
    ASIDE_M,
    GAP_M,
    MOVED_M,
    STANDING_MS,
    Moving,
    PartingPaths,
)

__all__ = ["Moving", "separated"]

#: Paths are changed for so long before and after a meeting, seconds.
_BEFORE_S = 5.0
#: The ways along which pairs part are found anew so often, at the most.
_OUTER = 6
#: Who is bent into something that stands, by more than this, metres, keeps to its way, and the
#: others are bent anew: so often at the most.
_TOUCH_M, _TRIES = 0.04, 3


def separated(
    moving: Moving,
    blocks: Blocks,
    height: NDArray[np.float64],
    step_s: float,
    aside: NDArray[np.float64] | None = None,
    begin: int | None = None,
    tell: Progress = untold,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return where actors are of whom fewer overlap (N, 2), and their speeds (N,).

    Who meets nobody, and who is on foot, keeps its path to the bit.

    Args:
        moving: everybody.
        blocks: what stands in the way, at whatever step.
        height: (N,) of each, metres.
        step_s: time between steps.
        aside: (N,) how far to the left of its own way each is already, metres; not at all where not
            given. Nobody goes farther aside in all than it may.
        begin: the first step that may be another, where it is not the first of all.
        tell: called with the fraction done (0..1) and what is being done.
    """
    xy, speed = moving.boxes.xy.copy(), moving.speed.copy()
    driving = np.array([one != "pedestrian" for one in moving.classes], np.bool_)[moving.actor]
    drives = driving if begin is None else driving & (moving.boxes.step >= begin)
    # Whom people meet among themselves changes nothing here.
    near = moving.pairs(ASIDE_M, xy, driving)
    meeting = np.zeros(len(xy), np.bool_)
    meeting[near[meetings(moving.boxes, near)[0] > -GAP_M]] = True
    rows = np.flatnonzero(drives)
    meeting[rows[blocks.beside(moving.boxes.take(rows), height[rows], 0.0)[0]]] = True
    changed = _around(moving, meeting & drives, near, step_s) & drives
    already = np.zeros(len(xy)) if aside is None else aside
    bent = xy, speed
    for attempt in range(_TRIES):
        if not changed.any():
            return xy, speed
        # The later attempts are rare.
        telling = between(tell, 1 - 0.5**attempt, 1 - 0.5 ** (attempt + 1))
        bent = _parted(moving, changed, blocks, height, step_s, already, telling)
        into = _bent_into(moving, bent[0], changed, blocks, height)
        if not into.any():
            break
        changed &= ~into
    return bent


def _parted(
    moving: Moving,
    changed: NDArray[np.bool_],
    blocks: Blocks,
    height: NDArray[np.float64],
    step_s: float,
    aside: NDArray[np.float64],
    tell: Progress,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return where actors are (N, 2), and their speeds (N,), some rows (N,) being changed."""
    xy, speed = moving.boxes.xy.copy(), moving.speed.copy()
    # Whoever else comes near keeps its path, and so does everybody before and after.
    near = moving.pairs(2 * ASIDE_M, xy, changed)
    there = changed | _within(changed, moving.actor, 2)
    there |= _within(changed[::-1], moving.actor[::-1], 2)[::-1]
    there[near[changed[near].any(axis=1)]] = True
    rows = np.flatnonzero(there)
    paths = PartingPaths(
        moving.take(rows), changed[rows], blocks, height[rows], step_s, aside[rows]
    )
    moved = np.zeros((len(rows), 2))
    for _ in each(range(_OUTER), tell, "past each other"):
        before, moved = moved, paths.apart(moved)
        if np.abs(moved - before).max() < MOVED_M:
            break
    xy[rows] = paths.place(moved)
    speed[rows] = paths.speeds(moved)
    return xy, speed


def _bent_into(
    moving: Moving,
    xy: NDArray[np.float64],
    changed: NDArray[np.bool_],
    blocks: Blocks,
    height: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Return the stretches of ways, as rows (N,), that are bent into something that stands.

    Those are not that lead into something that stands as they were.
    """
    rows = np.flatnonzero(changed & (xy != moving.boxes.xy).any(axis=1))
    own = moving.boxes.take(rows)
    was, now = (
        np.unique(blocks.beside(boxes, height[rows], -_TOUCH_M)[0])
        for boxes in (own, replace(own, xy=xy[rows]))
    )
    stretch = np.cumsum(np.diff(changed, prepend=False) | (np.diff(moving.actor, prepend=-1) != 0))
    into = np.zeros(int(stretch[-1]) + 1, np.bool_)
    into[stretch[rows[now]]] = True
    into[stretch[rows[was]]] = False
    return np.asarray(into[stretch] & changed)


def _around(
    moving: Moving, meeting: NDArray[np.bool_], near: NDArray[np.int64], step_s: float
) -> NDArray[np.bool_]:
    """Return the rows (N,) that are to be changed where some rows meet somebody.

    That is a while before and after them, of whoever comes near then too; who stands is moved for
    as long as it stands.
    """
    reach = round(_BEFORE_S / step_s)
    still = moving.speed < STANDING_MS
    stay = np.cumsum(np.concatenate([[True], ~(moving.joined & still[1:] & still[:-1])]))
    wanted = meeting.copy()
    for _ in range(2):
        stays = np.zeros(int(stay[-1]) + 1, np.bool_)
        stays[stay[wanted & still]] = True
        wanted |= stays[stay] & still
        wanted |= (
            _within(wanted, moving.actor, reach)
            | _within(wanted[::-1], moving.actor[::-1], reach)[::-1]
        )
        wanted[near[wanted[near].any(axis=1)]] = True
    return wanted


def _within(wanted: NDArray[np.bool_], actor: NDArray[np.integer], reach: int) -> NDArray[np.bool_]:
    """Return which rows (N,) follow a wanted one of the same actor by so many or fewer."""
    row = np.arange(len(wanted))
    last = np.maximum.accumulate(np.where(wanted, row, -1))
    return np.asarray((last >= 0) & (row - last <= reach) & (actor[last] == actor))
