"""Selection of frames to show: a range, and a step."""

from __future__ import annotations

from dataclasses import dataclass

from urbantwin.errors import InputError
from urbantwin.number_text import whole_number

__all__ = ["ChosenFrames"]

_EXPECTED = "A:B, numbers of frames from 0, B left out itself; either may be missing"


@dataclass(frozen=True)
class ChosenFrames:
    """Frames from ``first`` to before ``last``, every ``every``-th.

    Attributes:
        first: number of the first frame, from 0.
        last: end of the range, exclusive; None for all frames.
        every: step; 1 for every frame.
    """

    first: int = 0
    last: int | None = None
    every: int = 1

    @classmethod
    def of(cls, frames: str | None, every: int) -> ChosenFrames:
        """Return the selection of a text ``A:B`` and a step.

        Raises:
            InputError: they are malformed.
        """
        if every < 1:
            raise InputError(f"is {every}", place="every", expected="1 or more")
        if frames is None:
            return cls(every=every)
        words = frames.split(":")
        ends = [whole_number(word) if word.strip() else None for word in words]
        wrong = any(word.strip() and end is None for word, end in zip(words, ends, strict=True))
        if len(words) != 2 or wrong or any(end is not None and end < 0 for end in ends):
            raise InputError(f"{frames!r:.40}", place="frames", expected=_EXPECTED)
        first = ends[0] or 0
        if ends[1] is not None and ends[1] <= first:
            raise InputError(f"{frames} has no frame", place="frames", expected=_EXPECTED)
        return cls(first, ends[1], every)

    def rows(self, count: int) -> range:
        """Return the selected frame numbers, given the number of frames.

        Raises:
            InputError: the range begins behind the last frame.
        """
        if self.first and self.first >= count:
            raise InputError(
                f"begins at {self.first}, and there are {count} frames",
                place="frames",
                expected=_EXPECTED,
            )
        return range(self.first, count if self.last is None else min(self.last, count), self.every)
