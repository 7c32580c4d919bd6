"""JSON documents of artefacts: manifests and others."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

from urbantwin.errors import InputError
from urbantwin.strict_json import NotJsonError, parse_json

__all__ = ["as_json", "json_value", "read_bytes", "read_json", "read_json_value", "write_json"]

#: Largest document, bytes; larger ones would not fit into memory.
_MOST_BYTES = 4_000_000_000
#: An escaped UTF-16 surrogate in JSON, which cannot be encoded again if unpaired.
_HALF = re.compile(r"\\u[dD][89a-fA-F]")
_HALF_BYTES = re.compile(_HALF.pattern.encode())


def write_json(path: Path, value: object) -> None:
    """Write ``value`` as stable, readable JSON (keys in the given order, newline at the end)."""
    scratch = path.with_name(f".{path.name}.part")
    scratch.write_text(
        json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8"
    )
    scratch.replace(path)


def as_json(value: object) -> Any:  # noqa: ANN401
    """Return a JSON-compatible value.

    Tuples and arrays become lists, keys text, NaN null, and pydantic models mappings with the names
    used in files; other types become text.
    """
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json", by_alias=True)
    if isinstance(value, Mapping):
        return {str(key): as_json(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [as_json(item) for item in value]
    if isinstance(value, float) and math.isnan(value):
        return None
    return value if isinstance(value, str | int | float | bool | None) else str(value)


def read_json(path: Path, *, kind: str) -> dict[str, Any]:
    """Read a manifest, or another JSON document of UrbanTwin that is a mapping.

    Raises:
        InputError: the file is missing, is not JSON (see `json_value`), or is not a mapping.
    """
    value = read_json_value(path, f"a {kind}'s manifest")
    if not isinstance(value, dict):
        raise InputError("is not a mapping", file=path, expected=f"a {kind}'s manifest")
    return value


def read_json_value(path: Path, expected: str, *, once: bool = True) -> Any:  # noqa: ANN401
    """Read any JSON document.

    Args:
        path: the file.
        expected: expected content, for errors.
        once: see `json_value`.

    Raises:
        InputError: the file is missing, too large, or is not JSON.
    """
    data = read_bytes(path, expected)
    return json_value(data, file=path, expected=expected, once=once)


def read_bytes(path: Path, expected: str) -> bytes:
    """Return the bytes of a document.

    Raises:
        InputError: the file is missing, is not a regular file, is too large, or cannot be read.
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


def json_value(text: bytes | str, *, file: str | Path, expected: str, once: bool = True) -> Any:  # noqa: ANN401
    """Return the value of a JSON text (RFC 8259).

    Args:
        text: the document; bytes in UTF-8, UTF-16 or UTF-32.
        file: its source, for errors.
        expected: expected content, for errors.
        once: reject duplicate keys.

    Raises:
        InputError: not JSON, nested too deeply, a number that is not finite, or unpaired
            surrogates; names the line if known.
    """
    try:
        value = parse_json(text, once=once)
        if (_HALF_BYTES if isinstance(text, bytes) else _HALF).search(text):  # type: ignore[arg-type]
            json.dumps(value, ensure_ascii=False).encode()
    except NotJsonError as error:
        problem = f"is not JSON ({error.problem})"
        raise InputError(problem, file=file, place=error.place, expected=expected) from None
    except UnicodeError:
        raise InputError(
            "has text with unpaired surrogates", file=file, expected=expected
        ) from None
    except MemoryError:
        raise InputError("is too large for the memory", file=file, expected=expected) from None
    return value
