"""What a result says of itself in a few values, for a person and for a script."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from urbantwin.errors import readable

__all__ = ["Artefact", "Listing", "Result", "Summary"]

#: Most characters of a text that a result holds, on a terminal.
_LONGEST = 1500


class Summary(dict[str, Any]):
    """Values that JSON can hold; as text, a line for each, as the commands print them."""

    def __str__(self) -> str:
        """Return ``key: value`` lines."""
        return "\n".join(_lines_of(self))

    __repr__ = __str__

    def summary(self) -> Summary:
        """Return itself."""
        return self

    def text(self) -> str:
        """Return what a command prints for a person."""
        return str(self)


class Result:
    """What a function made or found."""

    def summary(self) -> Summary:
        """Return what is known of it in a few values."""
        raise NotImplementedError

    def text(self) -> str:
        """Return what a command prints for a person."""
        return str(self.summary())


class Artefact(Result):
    """A result on disk, which stands for its folder or file wherever a path is asked for.

    Its place is the attribute ``folder``, or ``path`` where it is one file.
    """

    def __fspath__(self) -> str:
        """Return its folder, or its file."""
        return str(getattr(self, "folder", None) or getattr(self, "path", ""))


class Listing(Result):
    """A catalogue: shown, it is a table."""

    @property
    def names(self) -> tuple[str, ...]:
        """The names of what it lists."""
        return ()

    def text(self) -> str:
        """Return what a command prints for a person: the table."""
        return repr(self)


def _lines_of(value: Mapping[str, Any], indent: str = "") -> Iterator[str]:
    """Yield ``key: value`` lines, what is inside a mapping or a list of mappings set in."""
    for key, item in value.items():
        if isinstance(item, Mapping) and not _fits_a_line(item):
            yield f"{indent}{_inline(key)}:"
            yield from _lines_of(item, indent + "  ")
        elif isinstance(item, list) and any(isinstance(one, Mapping) for one in item):
            yield f"{indent}{_inline(key)}:"
            yield from (f"{indent}  - {_inline(one)}" for one in item)
        elif isinstance(item, list) and len(item) > 1 and all(isinstance(x, str) for x in item):
            yield f"{indent}{_inline(key)}:"
            yield from (f"{indent}  {_inline(one)}" for one in item)
        elif item not in (None, []):
            yield f"{indent}{_inline(key)}: {_inline(item)}"


def _fits_a_line(value: Mapping[str, Any]) -> bool:
    return len(value) <= 8 and all(isinstance(one, int | float) for one in value.values())


def _inline(value: object) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{_inline(key)} {_inline(one)}" for key, one in value.items())
    if isinstance(value, list | tuple):
        return ", ".join(map(_inline, value))
    return readable(value, _LONGEST) if isinstance(value, str) else str(value)
