"""Progress reports of long functions."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

__all__ = ["Progress", "between", "each", "untold"]

#: Progress callback, called with the fraction done (0..1) and a description.
Progress = Callable[[float, str], None]

_Thing = TypeVar("_Thing")


def untold(share: float, doing: str) -> None:
    """Ignore progress."""


def between(tell: Progress, start: float, end: float, doing: str = "") -> Progress:
    """Return the progress callback of a part that covers a range of the whole.

    Args:
        tell: callback of the whole.
        start: fraction of the whole before the part.
        end: fraction of the whole after the part.
        doing: description of the part, which precedes the part's own descriptions.
    """

    def told(share: float, what: str) -> None:
        words = f"{doing}: {what}" if doing and what else doing or what
        tell(start + (end - start) * min(max(share, 0.0), 1.0), words)

    return told


def each(things: Sequence[_Thing], tell: Progress, doing: str = "") -> Iterator[_Thing]:
    """Yield things, and report before each the fraction of them that is done."""
    for number, thing in enumerate(things):
        tell(number / len(things), doing)
        yield thing
