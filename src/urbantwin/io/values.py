"""Checked values of untrusted JSON and bytes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin import strict_json

__all__ = [
    "MalformedError",
    "entry",
    "flag",
    "items",
    "matrix",
    "numbers",
    "parse_json",
    "table",
    "text",
    "whole",
]

#: Maximum plausible count or length in a file.
_LARGEST = 2**40


class MalformedError(ValueError):
    """A file violates its standard, or a limit; the text is the line to report."""


def parse_json(data: bytes, what: str) -> dict[str, Any]:
    """Return the JSON object of ``data``.

    Raises:
        MalformedError: it is not JSON, not an object, nested too deep, or contains NaN.
    """
    try:
        value = strict_json.parse_json(data)
    except ValueError as error:
        raise MalformedError(f"{what} is not JSON ({error})") from None
    if not isinstance(value, dict):
        raise MalformedError(f"{what} is not a JSON object")
    return value


def items(source: Mapping[str, Any], key: str) -> list[Any]:
    """Return the list at ``key``, or an empty one."""
    value = source.get(key)
    if value is None:
        return []
    if not isinstance(value, list):
        raise MalformedError(f"{key} is not a list")
    return value


def table(source: Mapping[str, Any], key: str) -> dict[str, Any]:
    """Return the object at ``key``, or an empty one."""
    value = source.get(key)
    if value is None:
        return {}
    if not isinstance(value, dict):
        raise MalformedError(f"{key} is not an object")
    return value


def text(source: Mapping[str, Any], key: str, default: str = "") -> str:
    """Return the text at ``key``."""
    value = source.get(key, default)
    if not isinstance(value, str):
        raise MalformedError(f"{key} is not text")
    return value


def entry(source: Mapping[str, Any], key: str, number: int) -> dict[str, Any]:
    """Return object ``number`` of the list at ``key``."""
    entries = items(source, key)
    if number >= len(entries) or not isinstance(entries[number], dict):
        raise MalformedError(f"refers to {key} {number}, which it does not have")
    found: dict[str, Any] = entries[number]
    return found


def flag(source: Mapping[str, Any], key: str) -> bool:
    """Return the truth value at ``key``; false if missing."""
    return source.get(key) is True


def whole(source: Mapping[str, Any], key: str, default: int | None = None) -> int:
    """Return the whole number at ``key``, from 0 to a limit above any real file."""
    value = source.get(key, default)
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    if not isinstance(value, int) or isinstance(value, bool):
        raise MalformedError(
            f"{key} is not a whole number" if key in source else f"{key} is missing"
        )
    if not 0 <= value <= _LARGEST:
        raise MalformedError(f"{key} is {value}")
    return value


def numbers(
    source: Mapping[str, Any], key: str, count: int, default: list[float] | None = None
) -> NDArray[np.float64]:
    """Return the ``count`` finite numbers at ``key``."""
    value = source.get(key, default)
    if not isinstance(value, list) or len(value) != count:
        raise MalformedError(f"{key} is not a list of {count} numbers")
    if not all(isinstance(v, int | float) and not isinstance(v, bool) for v in value):
        raise MalformedError(f"{key} is not a list of {count} numbers")
    try:
        finite = all(math.isfinite(v) for v in value)
    except OverflowError:
        finite = False
    if not finite:
        raise MalformedError(f"{key} holds a number without bounds")
    return np.array(value, np.float64)


def matrix(source: Mapping[str, Any], key: str) -> NDArray[np.float64]:
    """Return the (4, 4) affine transform at ``key``, stored column by column; identity if none."""
    if source.get(key) is None:
        return np.eye(4)
    value = numbers(source, key, 16).reshape(4, 4).T
    if not np.array_equal(value[3], [0, 0, 0, 1]):
        # some writers leave rounding errors; anything else is a projection
        if not np.allclose(value[3], [0, 0, 0, 1], atol=1e-6):
            raise MalformedError(f"{key} is not an affine transform")
        value = value.copy()
        value[3] = [0, 0, 0, 1]
    return value
