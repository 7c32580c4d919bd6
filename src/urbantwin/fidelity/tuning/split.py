"""The split of a recording into training, validation and held-out frames."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

from urbantwin.errors import InputError

__all__ = ["Split", "split_in_time"]

#: Share of the frames between the two parts that belong to neither: neighbours are alike.
_GAP = 0.05
#: Share of the frames before the gap on which a fit must prove itself before it is kept.
_VALIDATION = 0.25
#: With fewer frames before the gap, all of them are fitted to and none is left to prove it.
_LEAST_TO_VALIDATE = 4


@dataclass(frozen=True)
class Split:
    """Numbers of the frames of each part, ascending; parts follow each other in time.

    Attributes:
        training: what is fitted to.
        validation: what decides whether a fit is kept; empty where there are too few frames.
        gap: what belongs to no part.
        held_out: what is not read before the fit is written.
    """

    training: tuple[int, ...]
    validation: tuple[int, ...]
    gap: tuple[int, ...]
    held_out: tuple[int, ...]


def split_in_time(count: int, held_out: float = 0.3) -> Split:
    """Divide frames: the last ones are held out, a gap before them.

    Args:
        count: how many frames there are.
        held_out: share of them that is held out, above 0 and below 1; at least one frame is.

    Raises:
        InputError: fewer than two frames, or another share.
    """
    if not 0 < held_out < 1:
        raise InputError(
            f"the share held out is {held_out:g}", place="held-out", expected="above 0, below 1"
        )
    if count < 2:
        raise InputError(
            f"the recording holds {count} frame",
            expected="two at least: to fit to, and to judge the fit by",
        )
    last = min(count - 1, max(1, round(held_out * count)))
    before = count - last
    gap = min(math.ceil(_GAP * count), before - 1) if before > 3 else 0
    before -= gap
    proof = round(_VALIDATION * before) if before >= _LEAST_TO_VALIDATE else 0
    edges = (0, before - proof, before, before + gap, count)
    parts = [tuple(range(a, b)) for a, b in pairwise(edges)]
    return Split(*parts)
