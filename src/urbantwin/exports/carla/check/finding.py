"""What is checked of a package, and what was found."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

__all__ = ["Finding", "NoCarlaError", "Problems"]

Problems = Iterator[str]


class NoCarlaError(Exception):
    """A rule asks CARLA's library, which is not installed."""


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

    def told(self, most: int | None = None) -> list[str]:
        """Return what a person should be told: problems, the first of them, notes, or "sound"."""
        if self.missing:
            return [f"not applied: {self.missing}"]
        return [*self.problems[:most], *self.notes] if self.problems else ["sound", *self.notes]
