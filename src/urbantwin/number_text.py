"""Numbers as files write them: what Python's ``float`` takes beside them is none.

``float`` and ``int`` also understand ``1_0`` and the digits of every script, and ``float`` takes
``nan`` and ``inf``; no format that we read has them.
"""

from __future__ import annotations

import math
import warnings
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

__all__ = ["finite_number", "leading_numbers", "plain_number", "whole_number"]

#: Longer texts are no number of anything.
_LONGEST = 400
#: Whole numbers of more digits, leading zeros included, are not read.
_MOST_DIGITS = 40


def plain_number(text: str) -> float:
    """Return the number that a text says, which may be infinite or nan.

    Raises:
        ValueError: it says none.
    """
    if len(text) > _LONGEST or not text.isascii() or "_" in text:
        raise ValueError(f"{text[:20]!r} is no number")
    return float(text)


def finite_number(text: str | None) -> float | None:
    """Return the number that a text says; ``None`` where it says none, nan or one without end."""
    try:
        value = plain_number(text or "")
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def whole_number(text: str | None) -> int | None:
    """Return the whole number of 64 bits with a sign that a text says; ``None`` for all else."""
    digits = (text or "").strip().lstrip("+-")
    if len(digits) > _MOST_DIGITS or not (digits.isascii() and digits.isdecimal()):
        return None
    try:
        number = int(text or "")
    except ValueError:  # more than one sign
        return None
    return number if -(2**63) <= number < 2**63 else None


def leading_numbers(text: bytes) -> NDArray[np.float64]:
    """Return the numbers (N,) of a text that blanks part, up to the first word that is none."""
    import numpy as np

    if text.isspace() or not text:
        return np.zeros(0)  # numpy takes blanks for a number
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)
        try:
            return np.asarray(np.fromstring(text, sep=" "))
        except (ValueError, DeprecationWarning):
            pass
    good: list[float] = []
    for word in text.split():
        try:
            good.append(plain_number(word.decode("ascii", "replace")))
        except ValueError:
            break
    return np.asarray(good, np.float64)
