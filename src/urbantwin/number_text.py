"""Numbers as files write them: what Python's ``float`` takes beside them is none.

``float`` and ``int`` also understand ``1_0`` and the digits of every script, and ``float`` takes
``nan`` and ``inf``; no format that we read has them.
"""

from __future__ import annotations

import math

__all__ = ["finite_number", "plain_number", "whole_number"]

#: Longer texts are no number of anything.
_LONGEST = 400


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
    """Return the whole number of at most 18 digits that a text says; ``None`` for all else."""
    digits = (text or "").strip().lstrip("+-")
    if len(digits) > 18 or not (digits.isascii() and digits.isdecimal()):
        return None
    try:
        return int(text or "")
    except ValueError:  # more than one sign
        return None
