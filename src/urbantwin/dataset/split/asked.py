"""Options of a split: shares, gap, and thinning."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from urbantwin.errors import InputError
from urbantwin.number_text import finite_number

__all__ = ["PARTS", "SplitAsked", "shares_of"]

#: The parts in order of time; also the names of their lists in ``ImageSets/``.
PARTS = ("train", "val", "test")

_EXPECTED = "train,val,test as 70,15,15, or train,val as 80,20"
#: A gap longer than a day, or a larger displacement, is a mistake.
_LONGEST_S, _FARTHEST_M = 86_400.0, 1_000.0


def shares_of(given: str | Sequence[float], place: str = "--split") -> tuple[float, float, float]:
    """Return the shares of training, validation and test, with sum 1.

    Args:
        given: ``70,15,15``, or two or three numbers of any scale; without a third there is no test
            part.
        place: the option, for errors.

    Raises:
        InputError: not such numbers, or no share for training.
    """
    if isinstance(given, str):
        values = [finite_number(word.strip().removesuffix("%")) for word in given.split(",")]
    else:
        values = [float(value) if isinstance(value, int | float) else None for value in given]
    numbers = [
        value for value in values if value is not None and math.isfinite(value) and value >= 0
    ]
    if len(numbers) != len(values) or len(numbers) not in (2, 3) or not 0 < sum(numbers) < 1e300:
        raise InputError(f"{str(given)[:40]!r} are no shares", place=place, expected=_EXPECTED)
    if not numbers[0]:
        raise InputError("nothing is left to train on", place=place, expected=_EXPECTED)
    train, val, test = (*numbers, 0.0)[:3]
    total = train + val + test
    return train / total, val / total, test / total


@dataclass(frozen=True)
class SplitAsked:
    """Requested split.

    Attributes:
        shares: shares of training, validation and test.
        gap_s: seconds between the parts; ``None``: as long as the scene needs to change.
        moved_m: leave out frames in which no actor moved farther since the last kept one; ``None``:
            keep all.
    """

    shares: tuple[float, float, float] = (0.7, 0.15, 0.15)
    gap_s: float | None = None
    moved_m: float | None = None

    def __post_init__(self) -> None:
        """Validate gap and distance.

        Raises:
            InputError: negative, not finite or far too large.
        """
        for value, most, place, unit in (
            (self.gap_s, _LONGEST_S, "--gap", "seconds"),
            (self.moved_m, _FARTHEST_M, "--thin", "metres"),
        ):
            if value is not None and not 0 <= value <= most:
                raise InputError(f"is {value:g}", place=place, expected=f"0 to {most:g} {unit}")

    def told(self) -> dict[str, Any]:
        """Return it for ``made_from`` of the manifest."""
        shares = [round(100 * share, 6) for share in self.shares]
        return {"shares": shares, "gap_s": self.gap_s, "moved_m": self.moved_m}
