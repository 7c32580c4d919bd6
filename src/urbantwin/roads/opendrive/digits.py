"""Numbers as text: the same on every machine."""

from __future__ import annotations

from collections.abc import Iterable

__all__ = ["abcd", "number", "numbers"]


def number(value: float) -> str:
    """Return a number with 12 digits, and no minus before zero."""
    return format(float(value) if abs(value) > 1e-13 else 0.0, ".12g")


def numbers(**values: float) -> dict[str, str]:
    """Return attributes of an element."""
    return {key: number(value) for key, value in values.items()}


def abcd(values: Iterable[float]) -> dict[str, str]:
    """Return the four coefficients of a cubic as attributes."""
    return {letter: number(value) for letter, value in zip("abcd", values, strict=True)}
