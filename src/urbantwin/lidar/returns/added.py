"""Spurious echoes of the same beams: the strongest of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from urbantwin.lidar.returns.strays import Stray

__all__ = ["strongest_of"]

Floats = NDArray[np.float32]


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
