"""JSON, YAML and text files of datasets, read with one clear line for what is wrong."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

from urbantwin.artefact.arrays import one_line
from urbantwin.artefact.document import read_bytes, read_json_value
from urbantwin.errors import InputError
from urbantwin.number_text import finite_number

__all__ = [
    "finite_numbers",
    "laid_out",
    "read_json_document",
    "read_lines",
    "read_yaml_document",
]

#: libyaml's parser where it is there: ten times as fast on the labels of a street.
_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
#: Deeper than any description, and less than what the parsers' stacks hold.
_DEEPEST = 64


def read_json_document(path: Path, expected: str) -> Any:  # noqa: ANN401
    """Return what a JSON file holds.

    Raises:
        InputError: missing or not JSON.
    """
    return read_json_value(path, expected, once=False)


def read_yaml_document(path: Path, expected: str) -> Any:  # noqa: ANN401
    """Return what a YAML file of plain values holds.

    Raises:
        InputError: missing or not YAML, nested too deep, or with mappings merged into others.
    """
    try:
        text = read_bytes(path, expected).decode("utf-8-sig")
        depth = 0
        for event in yaml.parse(text, _LOADER):
            depth += isinstance(event, yaml.CollectionStartEvent)
            depth -= isinstance(event, yaml.CollectionEndEvent)
            # A few merged mappings of merged mappings would fill any memory.
            merged = isinstance(event, yaml.ScalarEvent) and event.value == "<<"
            if depth > _DEEPEST or merged:
                raise ValueError("merged mappings" if merged else "nested too deep")
        return yaml.load(text, _LOADER)
    except (yaml.YAMLError, ValueError, RecursionError, MemoryError) as error:
        problem = f"is not YAML ({one_line(error)})"
        raise InputError(problem, file=path, expected=expected) from None


def read_lines(path: Path, expected: str) -> list[str]:
    """Return the lines of a file of text; what is no UTF-8 in it is replaced.

    Raises:
        InputError: missing or not readable.
    """
    return read_bytes(path, expected).decode(errors="replace").splitlines()


def finite_numbers(words: Iterable[str]) -> list[float]:
    """Return numbers as they stand in a line.

    Raises:
        ValueError: a word is none, or is not finite.
    """
    found = []
    for word in words:
        value = finite_number(word)
        if value is None:
            raise ValueError(f"{word[:40]!r} is not a number")
        found.append(value)
    return found


@contextmanager
def laid_out(path: Path, expected: str, place: str | None = None) -> Iterator[None]:
    """Turn what goes wrong when a document's values are picked into one clear line.

    Args:
        path: the document, for errors.
        expected: what it should be, for errors.
        place: which of its rows or entries the values are of, for errors.

    Raises:
        InputError: a key, a type or a number in the block was not as expected.
    """
    try:
        yield
    except KeyError as error:
        problem = f"lacks {one_line(error)}"
        raise InputError(problem, file=path, place=place, expected=expected) from None
    except (
        ValueError,
        TypeError,
        IndexError,
        AttributeError,
        StopIteration,
        ArithmeticError,
        RecursionError,
    ) as error:
        problem = f"is not laid out right ({one_line(error)})"
        raise InputError(problem, file=path, place=place, expected=expected) from None
