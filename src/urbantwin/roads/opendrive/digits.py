"""Numbers as text, the same on every machine, and cubics as records."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from urbantwin.roads.model import Profile

__all__ = ["abcd", "number", "numbers", "records"]

#: Coefficients that differ less than this count as equal for ASAM's checker.
SAME = 1e-6
#: How far a profile may move where a record is left out as redundant, metres or radians.
LEFT_OUT = 2e-5


def number(value: float) -> str:
    """Return a number with 12 digits, and no minus before zero."""
    return format(float(value) if abs(value) > 1e-13 else 0.0, ".12g")


def numbers(**values: float) -> dict[str, str]:
    """Return attributes of an element."""
    return {key: number(value) for key, value in values.items()}


def abcd(values: Iterable[float]) -> dict[str, str]:
    """Return the four coefficients of a cubic as attributes."""
    return {letter: number(value) for letter, value in zip("abcd", values, strict=True)}


def records(profile: Profile, length: float) -> Iterator[tuple[float, NDArray[np.float64]]]:
    """Return start and coefficients of every record that a profile needs over a length.

    Records beyond the end, and those that only go on with the cubic before them, are left out
    (ASAM's rule ``performance.avoid_redundant_info``). The rule compares coefficients about station
    0, to 1e-6: cubics that it takes for one although they come apart by more than rounding are told
    apart by two micrometres.
    """
    ends = np.append(profile.start[1:], max(length, float(profile.start[-1]) + 1e-3))
    kept: tuple[float, NDArray[np.float64]] | None = None
    for start, row, end in zip(profile.start, profile.abcd, ends, strict=True):
        told = row
        if kept is not None:
            before = _moved(kept[1], start - kept[0])
            away = np.abs(_moved(before - row, np.linspace(0.0, end - start, 5))[..., 0]).max()
            apart = _moved(kept[1], -kept[0]) - _moved(row, -start)
            same = np.abs(apart).max() < SAME
            if start >= length - 1e-9 or (away <= LEFT_OUT and (same or away < 1e-9)):
                continue
            if same:
                told = row - [2 * SAME if apart[0] >= 0 else -2 * SAME, 0.0, 0.0, 0.0]
        kept = (float(start), told)
        yield kept


def _moved(row: NDArray[np.float64], by: float | NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the coefficients of a cubic about a place that lies ``by`` ahead."""
    a, b, c, d = row
    x = np.asarray(by, np.float64)
    return np.stack(
        [a + x * (b + x * (c + x * d)), b + x * (2 * c + 3 * d * x), c + 3 * d * x, d + 0 * x],
        axis=-1,
    )
