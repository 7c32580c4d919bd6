"""Handling of untrusted files: documents, numbers, limits, one-line errors."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from urbantwin.artefact.arrays import one_line
from urbantwin.artefact.document import read_bytes, read_json_value
from urbantwin.errors import InputError
from urbantwin.number_text import finite_number

__all__ = [
    "FARTHEST",
    "MOST_POINTS",
    "MOST_TRIANGLES",
    "check_coordinates",
    "content_of",
    "count_within",
    "finite_numbers",
    "laid_out",
    "read_json_document",
    "read_lines",
    "read_yaml_document",
    "reading",
    "valid_faces",
]

#: Maximum counts that fit into memory beside the rest (2 GB).
MOST_TRIANGLES = 12_000_000
MOST_POINTS = 40_000_000
#: Maximum coordinate, in any unit.
FARTHEST = 1e12


@contextmanager
def reading(path: Path, expected: str, place: str | None = None) -> Iterator[None]:
    """Convert any exception of a library into a one-line error with the file and the reason.

    Args:
        path: the file, for errors.
        expected: its format, for errors.
        place: the part of the file that is read, for errors.

    Raises:
        InputError: the library raised an exception.
        OSError: of the operating system, unchanged.
    """
    try:
        yield
    except (InputError, KeyboardInterrupt, SystemExit, GeneratorExit):
        raise
    except BaseException as error:  # panics of Rust are not derived from Exception
        if isinstance(error, OSError) and error.errno is not None:  # bz2 raises some without errno
            raise
        raise InputError(
            f"is not readable ({one_line(error)})", file=path, place=place, expected=expected
        ) from None


def content_of(path: Path) -> dict[str, str]:
    """Return the name of a file and its SHA-256."""
    with path.open("rb") as stream:
        return {path.name: hashlib.file_digest(stream, "sha256").hexdigest()}


def count_within(count: int, most: int, what: str, path: Path) -> None:
    """Raise an error for a count that exceeds memory, before memory is reserved for it.

    Raises:
        InputError: the count is above ``most``, or negative.
    """
    if not 0 <= count <= most:
        raise InputError(
            f"holds {count:,} {what}",
            file=path,
            expected=f"at most {most:,}; crop or thin it first",
        )


def check_coordinates(points: NDArray[np.float64], path: Path, what: str = "vertex") -> None:
    """Raise an error for coordinates that are not finite, or implausibly large in any unit.

    Raises:
        InputError: one is nan, infinite or beyond ``FARTHEST``.
    """
    bad = ~(np.abs(points) <= FARTHEST).all(axis=1)
    if bad.any():
        raise InputError(
            f"has {what} {int(np.argmax(bad)) + 1} of {len(points)} that is not a place "
            f"(nan, infinite or beyond {FARTHEST:g}; {int(bad.sum())} in all)",
            file=path,
            expected="finite coordinates",
        )


def valid_faces(
    faces: NDArray[np.int64] | NDArray[np.int32], vertices: int, path: Path
) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
    """Return faces as int32 without those that use a vertex twice, and the mask (F,) of kept ones.

    Raises:
        InputError: a face refers to a missing vertex.
    """
    wrong = ((faces < 0) | (faces >= vertices)).any(axis=1)
    if wrong.any():
        first = int(np.argmax(wrong))
        raise InputError(
            f"has face {first + 1} with vertex {int(faces[first].max()) + 1} of {vertices}",
            file=path,
            expected="faces between the vertices that it holds",
        )
    a, b, c = faces.T
    kept = (a != b) & (b != c) & (c != a)
    return faces[kept].astype(np.int32), kept


#: libyaml's parser if available: ten times as fast on the labels of a street.
_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
#: Maximum nesting: deeper than any description, and less than the parsers' stacks allow.
_DEEPEST = 64


def read_json_document(path: Path, expected: str) -> Any:  # noqa: ANN401
    """Return the content of a JSON file.

    Raises:
        InputError: missing or not JSON.
    """
    return read_json_value(path, expected, once=False)


def read_yaml_document(path: Path, expected: str) -> Any:  # noqa: ANN401
    """Return the content of a YAML file of plain values.

    Raises:
        InputError: missing or not YAML, nested too deep, or with merged mappings.
    """
    try:
        text = read_bytes(path, expected).decode("utf-8-sig")
        depth = 0
        for event in yaml.parse(text, _LOADER):
            depth += isinstance(event, yaml.CollectionStartEvent)
            depth -= isinstance(event, yaml.CollectionEndEvent)
            # Few nested merges can exceed any memory.
            merged = isinstance(event, yaml.ScalarEvent) and event.value == "<<"
            if depth > _DEEPEST or merged:
                raise ValueError("merged mappings" if merged else "nested too deep")
        return yaml.load(text, _LOADER)
    except (yaml.YAMLError, ValueError, RecursionError, MemoryError) as error:
        problem = f"is not YAML ({one_line(error)})"
        raise InputError(problem, file=path, expected=expected) from None


def read_lines(path: Path, expected: str) -> list[str]:
    """Return the lines of a text file; bytes that are not UTF-8 are replaced.

    Raises:
        InputError: missing or not readable.
    """
    return read_bytes(path, expected).decode(errors="replace").splitlines()


def finite_numbers(words: Iterable[str]) -> list[float]:
    """Return words as numbers.

    Raises:
        ValueError: a word is not a finite number.
    """
    numbers = []
    for word in words:
        value = finite_number(word)
        if value is None:
            raise ValueError(f"{word[:40]!r} is not a number")
        numbers.append(value)
    return numbers


@contextmanager
def laid_out(path: Path, expected: str, place: str | None = None) -> Iterator[None]:
    """Convert a wrong key, type or number in a document into a one-line error.

    Args:
        path: the document, for errors.
        expected: its format, for errors.
        place: the row or entry that is read, for errors.

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
