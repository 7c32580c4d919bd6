"""JSON documents read into the dataclasses that they were written from."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Annotated, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import PlainValidator, TypeAdapter, ValidationError

from urbantwin.artefact.document import json_value, read_bytes
from urbantwin.artefact.manifest import refused
from urbantwin.errors import InputError

__all__ = ["Numbers", "Pairs", "Quads", "Said", "Triples", "read_typed"]

Kind = TypeVar("Kind")

#: No length, height or place of a site is larger, metres.
_LARGEST = 1e7
#: Largest plausible number of a site, and patterns of larger ones in JSON.
_BEYOND = 1e12
_LONG = re.compile(rb"[eE]\+?0*[1-9]\d|(?<![\d.])\d{13}")
#: Characters in JSON that are not allowed in XML or users' texts.
_CONTROL = re.compile(rb"\\(u00[01][0-9a-fA-F]|[bf]|u[fF]{3}[eEfF])|\xef\xbf[\xbe\xbf]")
_CONTROLS = frozenset(chr(k) for k in (*range(9), 11, 12, *range(14, 32), 0xFFFE, 0xFFFF))
#: Byte order mark of some UTF-8 editors.
_MARK = b"\xef\xbb\xbf"


def _table(value: object, columns: int | None = None) -> NDArray[np.float64]:
    """Return lists of numbers as an array (N,) or (N, columns)."""
    if isinstance(value, np.ndarray):
        return value
    try:
        found = np.array(value)
    except (ValueError, OverflowError):
        raise ValueError("rows of numbers, as many in each") from None
    if not found.ndim or (found.size and found.dtype.kind not in "if"):
        raise ValueError("numbers")
    shape = (len(found),) if columns is None else (len(found), columns)
    if found.shape != shape and found.size:
        raise ValueError("numbers" if columns is None else f"rows of {columns} numbers")
    if np.abs(found).max(initial=0.0) > _LARGEST:
        raise ValueError(f"numbers up to {_LARGEST:g}")
    return found.astype(np.float64).reshape(shape)


def _said(value: object) -> float:
    if value is None:
        return math.nan
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError("a number or null")
    return float(value)


_Array = NDArray[np.float64]
#: Arrays (N,), (N, 2), (N, 3) and (N, 4) of finite numbers.
Numbers: TypeAlias = Annotated[_Array, PlainValidator(_table)]
Pairs: TypeAlias = Annotated[_Array, PlainValidator(partial(_table, columns=2))]
Triples: TypeAlias = Annotated[_Array, PlainValidator(partial(_table, columns=3))]
Quads: TypeAlias = Annotated[_Array, PlainValidator(partial(_table, columns=4))]
#: A number that may be missing: null in the file, NaN in Python.
Said: TypeAlias = Annotated[float, PlainValidator(_said)]


def _leaves(value: object) -> Iterator[object]:
    """Yield every key and every value within a document that is neither mapping nor list."""
    if isinstance(value, dict):
        yield from value
        yield from (leaf for one in value.values() for leaf in _leaves(one))
    elif isinstance(value, list):
        yield from (leaf for one in value for leaf in _leaves(one))
    else:
        yield value


def _has_control(value: object) -> bool:
    """Return whether a text in a document has a control character."""
    texts = (one for one in _leaves(value) if isinstance(one, str))
    return any(not _CONTROLS.isdisjoint(text) for text in texts)


def _has_beyond(value: object) -> bool:
    """Return whether a number with a point within a document is larger than any of a site."""
    return any(abs(one) > _BEYOND for one in _leaves(value) if isinstance(one, float))


def read_typed(path: Path, kind: type[Kind], expected: str) -> Kind:
    """Read a JSON file as a dataclass; missing fields are errors.

    Args:
        path: the file.
        kind: the dataclass; arrays in it are annotated with the types of this module.
        expected: expected content, for errors.

    Raises:
        InputError: missing, not JSON, or a field is missing or wrong; names the first.
    """
    data = read_bytes(path, expected)
    value = json_value(data, file=path, expected=expected)
    if not isinstance(value, dict):
        raise InputError("is not a mapping", file=path, expected=expected)
    if _CONTROL.search(data) and _has_control(value):
        raise InputError("has text with unpaired surrogates", file=path, expected=expected)
    if _LONG.search(data) and _has_beyond(value):
        raise InputError(f"has a number beyond {_BEYOND:g}", file=path, expected=expected)
    try:
        found: Kind = TypeAdapter(kind).validate_json(data.removeprefix(_MARK), strict=True)
    except ValidationError as error:
        raise refused(error, file=path, expected=expected) from None
    return found
