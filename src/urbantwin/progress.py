"""How far a long function is: what it tells, and how its parts tell theirs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

__all__ = ["Progress", "between", "each", "untold"]

#: What every long function calls: the share that is done (0..1) and what is being done.
Progress = Callable[[float, str], None]

_Thing = TypeVar("_Thing")


def untold(share: float, doing: str) -> None:
    """Tell nobody."""


def between(tell: Progress, start: float, end: float, doing: str = "") -> Progress:
    """Return what a part calls that takes a whole from one share to another.

    Args:
        tell: what the whole calls.
        start: share of the whole that is done before the part.
        end: and after it.
        doing: what the whole calls the part; the part's own words follow it.
    """

    def told(share: float, what: str) -> None:
        words = f"{doing}: {what}" if doing and what else doing or what
        tell(start + (end - start) * min(max(share, 0.0), 1.0), words)

    return told


def each(things: Sequence[_Thing], tell: Progress, doing: str = "") -> Iterator[_Thing]:
    """Yield things, and tell before each the share of them that is done."""
    for number, thing in enumerate(things):
        tell(number / len(things), doing)
        yield thing
