"""What is checked of a package, and what was found."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

__all__ = ["Finding", "Problems"]

Problems = Iterator[str]


@dataclass(frozen=True)
class Finding:
    """A rule, and what of a package breaks it.

    Attributes:
        rule: what is asked for.
        read_by: who in CARLA relies on it.
        problems: what breaks it.
        notes: what is as it may be, and still good to know.
        missing: what the rule needs that is not installed; it was not applied.
    """

    rule: str
    read_by: str
    problems: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    missing: str = ""
