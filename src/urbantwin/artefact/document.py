"""JSON documents: manifests and what else artefacts hold as text."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from urbantwin.errors import InputError

__all__ = ["json_value", "read_bytes", "read_json", "read_json_value", "write_json"]

#: Larger than any document that a person's machine could hold as Python's objects.
_MOST_BYTES = 1_000_000_000
#: Whole numbers have no more digits: beyond, not even a float of twice the width is exact.
_MOST_DIGITS = 18
#: Half of a character of UTF-16 as JSON may escape it: no text that can be written again.
_HALF = re.compile(r"\\u[dD][89a-fA-F]")


def write_json(path: Path, value: object) -> None:
    """Write ``value`` as stable, readable JSON (keys in the given order, newline at the end)."""
    scratch = path.with_name(f".{path.name}.part")
    scratch.write_text(json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False) + "\n")
    scratch.replace(path)


def read_json(path: Path, *, kind: str) -> dict[str, Any]:
    """Read an artefact's manifest, or another document of ours that is a mapping.

    Raises:
        InputError: the file is missing, is not JSON (see `json_value`), or is not a mapping.
    """
    value = read_json_value(path, f"a {kind}'s manifest")
    if not isinstance(value, dict):
        raise InputError("is not a mapping", file=path, expected=f"a {kind}'s manifest")
    return value


def read_json_value(path: Path, expected: str, *, strict: bool = True) -> Any:  # noqa: ANN401
    """Read any JSON document.

    Args:
        path: the file.
        expected: what it should be, for errors.
        strict: see `json_value`.

    Raises:
        InputError: the file is missing, too large, or is not JSON.
    """
    data = read_bytes(path, expected)
    return json_value(data, file=path, expected=expected, strict=strict)


def read_bytes(path: Path, expected: str) -> bytes:
    """Return the bytes of a document.

    Raises:
        InputError: the file is missing, is none, is too large or cannot be read.
    """
    try:
        if path.exists() and not path.is_file():
            raise InputError("is not a file", file=path, expected=expected)
        if path.stat().st_size > _MOST_BYTES:
            most = f"at most {_MOST_BYTES / 1e9:g} GB"
            raise InputError("is too large", file=path, expected=most)
        return path.read_bytes()
    except FileNotFoundError:
        raise InputError("not found", file=path, expected=expected) from None
    except OSError as error:
        why = error.strerror or "unknown"
        raise InputError(f"cannot be read ({why})", file=path, expected=expected) from None


def json_value(
    text: bytes | str,
    *,
    file: str | Path,
    expected: str,
    strict: bool = True,
) -> Any:  # noqa: ANN401
    """Return what a JSON text holds (RFC 8259).

    Args:
        text: the document; bytes are UTF-8, with or without its mark.
        file: where it is from, for errors.
        expected: what it should be, for errors.
        strict: refuse what no file of ours has: a number that is not finite or has more than 18
            digits, and a key that is given twice. Other people's files may have them.

    Raises:
        InputError: it is not JSON, or is nested too deep; the line is named.
    """
    try:
        if isinstance(text, bytes):
            text = text.decode("utf-8-sig")
        if strict:
            value = json.loads(
                text,
                parse_float=_finite,
                parse_int=_whole,
                parse_constant=_finite,
                object_pairs_hook=_once,
            )
        else:
            value = json.loads(text)
        if _HALF.search(text):
            json.dumps(value, ensure_ascii=False).encode()
    except json.JSONDecodeError as error:
        problem, place = f"is not JSON ({error.msg})", f"line {error.lineno}"
        raise InputError(problem, file=file, place=place, expected=expected) from None
    except UnicodeError:
        raise InputError("is not text in UTF-8", file=file, expected=expected) from None
    except RecursionError:
        raise InputError("is nested too deep", file=file, expected=expected) from None
    except MemoryError:
        raise InputError("is too large for the memory", file=file, expected=expected) from None
    except ValueError as error:
        # Ours, and Python's own of a whole number that is longer than it reads.
        problem = str(error) if isinstance(error, _WrongError) else "has a number that is too long"
        raise InputError(problem, file=file, expected=expected) from None
    return value


class _WrongError(ValueError):
    """What no document of ours holds."""


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise _WrongError(f"has the number {text[:40]}, which is not finite")
    return value


def _whole(text: str) -> int:
    if len(text) > _MOST_DIGITS:
        raise _WrongError(f"has a whole number of {len(text)} digits")
    return int(text)


def _once(pairs: Sequence[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        seen: set[str] = set()
        twice = next(key for key, _ in pairs if key in seen or seen.add(key))  # type: ignore[func-returns-value]
        raise _WrongError(f"gives {twice[:40]!r} twice")
    return found
