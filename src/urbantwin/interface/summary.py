"""Base classes of results, with short summaries for people and scripts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from urbantwin.errors import readable

__all__ = ["Artefact", "Listing", "Result", "Summary"]

#: Most characters of a text value shown on a terminal.
_LONGEST = 1500


class Summary(dict[str, Any]):
    """JSON-compatible values; as text, one line each, as the commands print them."""

    def __str__(self) -> str:
        """Return ``key: value`` lines."""
        return "\n".join(_lines_of(self))

    __repr__ = __str__

    def summary(self) -> Summary:
        """Return itself."""
        return self

    def text(self) -> str:
        """Return the text that a command prints."""
        return str(self)


class Result:
    """Result of a function."""

    def summary(self) -> Summary:
        """Return the main values."""
        raise NotImplementedError

    def text(self) -> str:
        """Return the text that a command prints."""
        return str(self.summary())


class Artefact(Result):
    """A result on disk, which can be passed as the path of its folder or file.

    Its path is the attribute ``folder``, or ``path`` for a single file.
    """

    def __fspath__(self) -> str:
        """Return the path of its folder or file."""
        return str(getattr(self, "folder", None) or getattr(self, "path", ""))


class Listing(Result):
    """A catalogue, printed as a table."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the entries."""
        return ()

    def text(self) -> str:
        """Return the text that a command prints: the table."""
        return repr(self)


def _lines_of(value: Mapping[str, Any], indent: str = "") -> Iterator[str]:
    """Yield ``key: value`` lines; nested mappings and lists are indented."""
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
