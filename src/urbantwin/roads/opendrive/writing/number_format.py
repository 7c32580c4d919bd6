"""Platform-independent formatting of numbers and names, and cubics as records."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Sequence

from urbantwin.roads.model import Profile

__all__ = ["abcd", "number", "numbers", "records", "xml_text"]

#: Coefficients with a smaller difference are equal for ASAM's checker.
SAME = 1e-6
#: Maximum change of a profile when a redundant record is left out, metres or radians.
LEFT_OUT = 2e-5
#: Shares of a record's length at which two cubics are compared.
SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)
#: Characters invalid in XML 1.0: control characters and single surrogates.
_NOT_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def xml_text(text: str) -> str:
    """Return a text without the characters that are invalid in XML."""
    return _NOT_XML.sub("", text)


def number(value: float) -> str:
    """Return a number with 12 digits, without negative zero."""
    return format(float(value) if abs(value) > 1e-13 else 0.0, ".12g")


def numbers(**values: float) -> dict[str, str]:
    """Return numbers as attributes of an element."""
    return {key: number(value) for key, value in values.items()}


def abcd(values: Iterable[float]) -> dict[str, str]:
    """Return the four coefficients of a cubic as attributes."""
    return {letter: number(value) for letter, value in zip("abcd", values, strict=True)}


def records(profile: Profile, length: float) -> Iterator[tuple[float, list[float]]]:
    """Yield start and coefficients of each record that a profile needs over a length.

    Records beyond the end, and those that continue the previous cubic, are left out (ASAM's rule
    ``performance.avoid_redundant_info``). The rule compares coefficients about station 0, to 1e-6.
    Cubics that it would merge although they differ by more than rounding are made distinct by two
    micrometres.
    """
    starts, rows = profile.start.tolist(), profile.abcd.tolist()
    ends = [*starts[1:], max(length, starts[-1] + 1e-3)]
    previous: tuple[float, list[float]] | None = None
    for start, row, end in zip(starts, rows, ends, strict=True):
        written = row
        if previous is not None:
            if start >= length - 1e-9:
                continue
            before = _moved(previous[1], start - previous[0])
            gap = [a - b for a, b in zip(before, row, strict=True)]
            deviation = max(abs(_moved(gap, share * (end - start))[0]) for share in SHARES)
            pairs = zip(_moved(previous[1], -previous[0]), _moved(row, -start), strict=True)
            differences = [a - b for a, b in pairs]
            is_same = max(map(abs, differences)) < SAME
            if deviation <= LEFT_OUT and (is_same or deviation < 1e-9):
                continue
            if is_same:
                written = [row[0] - math.copysign(2 * SAME, differences[0]), *row[1:]]
        previous = (start, written)
        yield previous


def _moved(row: Sequence[float], by: float) -> list[float]:
    """Return the coefficients of a cubic about a point ``by`` ahead."""
    a, b, c, d = row
    return [
        a + by * (b + by * (c + by * d)),
        b + by * (2 * c + 3 * d * by),
        c + 3 * d * by,
        d,
    ]
