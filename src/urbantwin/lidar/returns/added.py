"""Insertion of spurious echoes among those of surfaces."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from urbantwin.lidar.returns.strays import Stray

__all__ = ["Inserted", "inserted", "strongest_of"]

Floats = NDArray[np.float32]
Whole = NDArray[np.int64]


class Inserted(NamedTuple):
    """Where added echoes go among M that are reported already, in the order of their beams.

    Attributes:
        order: (M',) int64, the rows of the new report: below M those of the old one, from M on the
            added ones.
        echo: (M',) uint8, number of each among the echoes of its beam.
    """

    order: Whole
    echo: NDArray[np.uint8]


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
    strength: Floats,
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
        strength: (M,) of the reported echoes.
        added: (A,) echoes, ascending by beam.
        added_strength: (A,).
        returns: what the sensor reports.
    """
    count = len(beam)
    low = np.searchsorted(beam, added.beam, "left")
    at = np.minimum(low, max(count - 1, 0))
    after = np.minimum(low + 1, max(count - 1, 0))
    has, more = np.zeros(len(low), np.bool_), np.zeros(len(low), np.bool_)
    if count:
        has = (low < count) & (beam[at] == added.beam)
        more = (low + 1 < count) & (beam[after] == added.beam)
    several = has.astype(np.int64) + (has & more)
    stronger, farther = np.ones(len(low), np.bool_), np.ones(len(low), np.bool_)
    if count:
        stronger = ~has | (added_strength > strength[at])
        farther = ~has | (added.range_m > range_m[at])
    number = np.arange(count, count + len(low))
    order = np.arange(count)
    if returns == "dual":
        taken = (several == 2) & stronger
        fresh = several < 2
        # The stronger of two stands first.
        place = np.where(has & ~stronger, low + 1, low)
    else:
        nearer = ~has | ~farther
        wins = {"strongest": stronger, "last": farther, "first": nearer}[returns]
        taken, fresh = has & wins, ~has
        place = low
    order[low[taken]] = number[taken]
    order = np.insert(order, place[fresh], number[fresh])
    beams = np.concatenate([beam, added.beam])[order]
    echo = np.zeros(len(order), np.uint8)
    echo[1:] = beams[1:] == beams[:-1]
    return Inserted(order, echo)
