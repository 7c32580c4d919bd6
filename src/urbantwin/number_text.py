"""Strict parsing of numbers in files.

Python's ``float`` and ``int`` also accept ``1_0`` and digits of every script, and ``float`` accepts
``nan`` and ``inf``; no format read here allows them.
"""

from __future__ import annotations

import math
import warnings
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

__all__ = ["finite_number", "leading_numbers", "plain_number", "whole_number"]

#: Longest text of a number, characters.
_LONGEST = 400
#: Most digits of an integer that is read, leading zeros included.
_MOST_DIGITS = 40


def plain_number(text: str) -> float:
    """Return the number in a text; may be infinite or nan.

    Raises:
        ValueError: the text is not a number.
    """
    if len(text) > _LONGEST or not text.isascii() or "_" in text:
        raise ValueError(f"{text[:20]!r} is no number")
    return float(text)


def finite_number(text: str | None) -> float | None:
    """Return the number in a text; ``None`` if it is not a finite number."""
    try:
        value = plain_number(text or "")
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def whole_number(text: str | None) -> int | None:
    """Return the signed 64-bit integer in a text; ``None`` for anything else."""
    digits = (text or "").strip().lstrip("+-")
    if len(digits) > _MOST_DIGITS or not (digits.isascii() and digits.isdecimal()):
        return None
    try:
        number = int(text or "")
    except ValueError:  # several signs
        return None
    return number if -(2**63) <= number < 2**63 else None


def leading_numbers(text: bytes) -> NDArray[np.float64]:
    """Return the blank-separated numbers (N,) of a text, up to the first other word."""
    import numpy as np

    if text.isspace() or not text:
        return np.zeros(0)  # numpy would read a blank text as a number
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
