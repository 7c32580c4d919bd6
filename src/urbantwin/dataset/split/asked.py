"""What a person asks of a split: shares, the gap, and whether frames are thinned."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from urbantwin.errors import InputError
from urbantwin.number_text import finite_number

__all__ = ["PARTS", "SplitAsked", "shares_of"]

#: The parts in the order of time, and the names of their lists in ``ImageSets/``.
PARTS = ("train", "val", "test")

_EXPECTED = "train,val,test as 70,15,15, or train,val as 80,20"
#: A longer gap than a day, or actors that move farther than this, are slips.
_LONGEST_S, _FARTHEST_M = 86_400.0, 1_000.0


def shares_of(given: str | Sequence[float], place: str = "--split") -> tuple[float, float, float]:
    """Return the shares of training, validation and test, which add up to 1.

    Args:
        given: ``70,15,15`` or two or three numbers of any scale; without a third, nothing tests.
        place: the option, for errors.

    Raises:
        InputError: they are not such numbers, or nothing would train.
    """
    if isinstance(given, str):
        values = [finite_number(word.strip().removesuffix("%")) for word in given.split(",")]
    else:
        values = [float(one) if isinstance(one, int | float) else None for one in given]
    numbers = [one for one in values if one is not None and math.isfinite(one) and one >= 0]
    if len(numbers) != len(values) or len(numbers) not in (2, 3) or not 0 < sum(numbers) < 1e300:
        raise InputError(f"{str(given)[:40]!r} are no shares", place=place, expected=_EXPECTED)
    if not numbers[0]:
        raise InputError("nothing is left to train on", place=place, expected=_EXPECTED)
    train, val, test = (*numbers, 0.0)[:3]
    total = train + val + test
    return train / total, val / total, test / total


@dataclass(frozen=True)
class SplitAsked:
    """What a split follows from.

    Attributes:
        shares: of training, validation and test.
        gap_s: seconds between the parts; ``None``: as long as the scene needs to change.
        moved_m: frames in which nobody moved farther since the last one kept are left out of the
            parts; ``None``: all are kept.
    """

    shares: tuple[float, float, float] = (0.7, 0.15, 0.15)
    gap_s: float | None = None
    moved_m: float | None = None

    def __post_init__(self) -> None:
        """Refuse gaps and distances that are none.

        Raises:
            InputError: one is negative, not finite or far too large.
        """
        for value, most, place, unit in (
            (self.gap_s, _LONGEST_S, "--gap", "seconds"),
            (self.moved_m, _FARTHEST_M, "--thin", "metres"),
        ):
            if value is not None and not 0 <= value <= most:
                raise InputError(f"is {value:g}", place=place, expected=f"0 to {most:g} {unit}")

    def told(self) -> dict[str, Any]:
        """Return it as ``made_from`` keeps it, for who makes the dataset again."""
        shares = [round(100 * one, 6) for one in self.shares]
        return {"shares": shares, "gap_s": self.gap_s, "moved_m": self.moved_m}
