"""Axes of a grid, each with its levels, and the cells that a design makes of them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from urbantwin.errors import InputError

__all__ = ["MOST_CELLS", "Axis", "Cell", "Level", "factorial", "one_at_a_time"]

#: What an axis is set to: a number or a name.
Level = int | float | str

#: Nobody waits for more.
MOST_CELLS = 100_000


@dataclass(frozen=True)
class Axis:
    """Something that is varied.

    Attributes:
        name: as it stands in the file.
        levels: at least one, each once; the first is the base, which the others are compared with.
    """

    name: str
    levels: tuple[Level, ...]

    @property
    def base(self) -> Level:
        """The level that the others are compared with."""
        return self.levels[0]

    def twice(self) -> Level | None:
        """Return a level that is given twice, or ``None``; 1 and 1.0 are the same."""
        seen: list[Level] = []
        for one in self.levels:
            if one in seen:
                return one
            seen.append(one)
        return None


@dataclass(frozen=True)
class Cell:
    """One level of each axis.

    Attributes:
        levels: by the axis' name, in the order of the axes.
    """

    levels: Mapping[str, Level]

    def name(self, axes: Sequence[Axis]) -> str:
        """Return what differs from the base: ``fog_visibility_m=200``; ``base`` where nothing."""
        told = [f"{name}={told_level(self.levels[name])}" for name in self.other(axes)]
        return ", ".join(told) or "base"

    def other(self, axes: Sequence[Axis]) -> tuple[str, ...]:
        """Return the axes that are not at their base."""
        return tuple(one.name for one in axes if self.levels[one.name] != one.base)

    def at(self, **levels: Level) -> Cell:
        """Return the cell with some axes at other levels."""
        return Cell({**self.levels, **levels})


def told_level(level: Level) -> str:
    """Return a level as text: ``0.05``, ``none``."""
    return level if isinstance(level, str) else f"{level:.10g}"


def one_at_a_time(axes: Sequence[Axis]) -> tuple[Cell, ...]:
    """Return the base, and a cell for every other level of each axis, the others at their base."""
    base = Cell({one.name: one.base for one in axes})
    return (base, *(base.at(**{one.name: level}) for one in axes for level in one.levels[1:]))


def factorial(axes: Sequence[Axis]) -> tuple[Cell, ...]:
    """Return a cell for every combination of levels, the base first, the last axis the fastest.

    Raises:
        InputError: there are more than `MOST_CELLS`.
    """
    count = math.prod(len(one.levels) for one in axes)
    if count > MOST_CELLS:
        raise InputError(
            f"{count} combinations of levels", expected=f"at most {MOST_CELLS}, or fewer levels"
        )
    return tuple(_combinations(axes))


def _combinations(axes: Sequence[Axis]) -> Iterator[Cell]:
    for levels in itertools.product(*(one.levels for one in axes)):
        yield Cell({axis.name: level for axis, level in zip(axes, levels, strict=True)})
