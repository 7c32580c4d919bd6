"""Insertion of spurious echoes among those of surfaces."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from urbantwin.lidar.returns.strays import Stray

__all__ = ["Inserted", "inserted", "strongest_of"]

Floats = NDArray[np.float32]
Whole = NDArray[np.int64]


class Inserted(NamedTuple):
    """Which K of the added echoes are reported, and where among M that are reported already.

    In the order of their beams.

    Attributes:
        number: (K,) int64, of each among those that are added.
        row: (K,) int64, before which it goes, or whose place it takes.
        fresh: (K,) whether it goes before that row.
    """

    number: Whole
    row: Whole
    fresh: NDArray[np.bool_]


def strongest_of(strays: list[Stray], strength: list[Floats]) -> tuple[Stray, Floats]:
    """Return the strongest added echo of every beam that has any, and its strength.

    Args:
        strays: echoes, several of the same beam among them.
        strength: of each.
    """
    beam = np.concatenate([one.beam for one in strays])
    strong = np.concatenate(strength)
    range_m = np.concatenate([one.range_m for one in strays])
    amplitude = np.concatenate([one.amplitude for one in strays])
    order = np.argsort(beam, kind="stable")
    own = np.flatnonzero(np.diff(beam[order], prepend=-1) > 0)
    if len(own) < len(beam):
        best = np.repeat(np.maximum.reduceat(strong[order], own), np.diff(own, append=len(beam)))
        order = order[strong[order] == best]
        order = order[np.diff(beam[order], prepend=-1) > 0]  # Of two as strong, the first.
    return Stray(beam[order], range_m[order], amplitude[order]), strong[order]


def inserted(
    beam: NDArray[np.int32],
    range_m: Floats,
    strength: Callable[[Whole], Floats],
    added: Stray,
    added_strength: Floats,
    returns: Literal["strongest", "last", "first", "dual"],
) -> Inserted:
    """Return where detected echoes go, at most one of a beam, among those that are reported.

    A sensor that reports the strongest echo takes an added one for it where that is stronger; one
    that reports the last takes one that is farther, and one that reports the first a nearer one.
    One that reports two has room for it beside a single one, else it takes the place of the first
    if it is stronger.

    Args:
        beam: (M,) of the reported echoes, ascending; two of a beam stand in the order of reporting.
        range_m: (M,) of the reported echoes.
        strength: returns those of some of the reported echoes, by their rows.
        added: (A,) echoes, ascending by beam.
        added_strength: (A,).
        returns: what the sensor reports.
    """
    count = len(beam)
    low = np.searchsorted(beam, added.beam, "left")
    has, more = np.zeros(len(low), np.bool_), np.zeros(len(low), np.bool_)
    stronger, farther = np.ones(len(low), np.bool_), np.ones(len(low), np.bool_)
    if count:
        has = (low < count) & (beam[np.minimum(low, count - 1)] == added.beam)
        more = (low + 1 < count) & (beam[np.minimum(low + 1, count - 1)] == added.beam)
        met = np.flatnonzero(has)
        stronger[met] = added_strength[met] > strength(low[met])
        farther[met] = added.range_m[met] > range_m[low[met]]
    if returns == "dual":
        taken = has & more & stronger
        fresh = ~(has & more)
        # The stronger of two stands first.
        row = np.where(has & ~stronger, low + 1, low)
    else:
        wins = {"strongest": stronger, "last": farther, "first": ~farther}[returns]
        taken, fresh = has & wins, ~has
        row = low
    number = np.flatnonzero(taken | fresh)
    return Inserted(number, row[number], fresh[number])
