"""A recording: the frames of one sensor or rig in order, whatever dataset they are from."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from urbantwin.fidelity.frame import Frame

__all__ = ["Recording"]


@dataclass(frozen=True, eq=False)
class Recording:
    """Frames that are read when they are asked for.

    Attributes:
        path: the folder or file that holds them.
        layout: how it is laid out: one of ``readers.LAYOUTS``.
        names: of the frames in their order, without folders.
        read_frame: reads the frame of a number; raises InputError where its file is bad.
        notes: what a reader of figures must know about the whole of it, one sentence each.
        again: opens it anew: what goes to another process in place of an open one.
    """

    path: Path
    layout: str
    names: tuple[str, ...]
    read_frame: Callable[[int], Frame] = field(repr=False)
    notes: tuple[str, ...] = ()
    again: Callable[[], Recording] | None = field(default=None, repr=False)

    def __reduce__(self) -> str | tuple[Any, ...]:
        """Go to another process as what opens it."""
        return super().__reduce__() if self.again is None else (self.again, ())

    def __len__(self) -> int:
        """Return how many frames there are."""
        return len(self.names)

    def read(self, index: int) -> Frame:
        """Read one frame, 0 <= index < len.

        Raises:
            InputError: its file, or the labels that belong to it, are not right; the other
                frames can still be read.
        """
        if not 0 <= index < len(self.names):
            raise IndexError(f"frame {index} of {len(self.names)}")
        return self.read_frame(index)

    def __iter__(self) -> Iterator[Frame]:
        """Read the frames one after the other."""
        return (self.read(index) for index in range(len(self)))

    def only(self, names: Collection[str]) -> Recording:
        """Return it with the frames of some names alone."""
        numbers = [number for number, name in enumerate(self.names) if name in names]
        again = None if self.again is None else partial(_only, self.again, names)
        return replace(
            self,
            names=tuple(self.names[number] for number in numbers),
            read_frame=lambda index: self.read(numbers[index]),
            again=again,
        )


def _only(again: Callable[[], Recording], names: Collection[str]) -> Recording:
    return again().only(names)
