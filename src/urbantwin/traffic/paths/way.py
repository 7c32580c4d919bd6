"""Ways: how far somebody is on its own way at each step, and whom it lets go first."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.traffic.paths.retiming import Pace

__all__ = ["BEHIND_M", "Let", "Way"]

#: How far one falls behind at the most, metres.
BEHIND_M = 30.0


@dataclass(frozen=True, eq=False)
class Let:
    """That somebody lets another go first when they meet.

    Attributes:
        first: the other's way.
        since: the step of its own way since which they would lie in each other.
        begin: the first of its steps in which it has to do with the other.
        bound: how far it may be in these steps, metres; infinite where it is free.
    """

    first: int
    since: int
    begin: int
    bound: NDArray[np.float64]

    @property
    def until(self) -> int:
        """The step after the last."""
        return self.begin + len(self.bound)


@dataclass(eq=False)
class Way:
    """Somebody's way while it is there without a gap.

    Attributes:
        number: of the way.
        bodies: (B, N) rows of the columns by time, of whoever goes first and those that it draws.
        kind: its class.
        pace: how it may go.
        at: (N,) how far it is now, metres.
        start: the step of the motion in which it begins.
        lets: whom it lets go first.
    """

    number: int
    bodies: NDArray[np.int64]
    kind: str
    pace: Pace
    at: NDArray[np.float64]
    start: int
    lets: tuple[Let, ...] = ()

    @cached_property
    def _strictly(self) -> NDArray[np.float64]:
        return self.pace.at + 1e-7 * np.arange(len(self.pace.at))

    def between(
        self,
        values: NDArray[Any],
        body: int,
        at: NDArray[np.float64],
        part: slice = slice(None),
    ) -> NDArray[Any]:
        """Return what a body's values (rows, ...) are where the way is so far, in a part of it."""
        strictly = self._strictly[part]
        when = np.interp(at, strictly, np.arange(len(strictly), dtype=np.float64))
        low = np.minimum(when.astype(int), len(strictly) - 1)
        high = np.minimum(low + 1, len(strictly) - 1)
        share = (when - low).reshape(-1, *[1] * (values.ndim - 1))
        mine = values[self.bodies[body][part]]
        return np.asarray(mine[low] + (mine[high] - mine[low]) * share)

    def row_at(self, at: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return when it was so far itself, in its own steps, not whole."""
        return np.interp(at, self._strictly, np.arange(len(self._strictly), dtype=np.float64))

    def part(self, low_m: float, high_m: float) -> slice:
        """Return the steps within which the way goes from one length to another."""
        first, last = np.searchsorted(self._strictly, [low_m, high_m])
        return slice(max(int(first) - 1, 0), int(last) + 2)
