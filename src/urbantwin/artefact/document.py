"""JSON documents: manifests and what else artefacts hold as text."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from urbantwin.errors import InputError

__all__ = ["read_json", "write_json"]


def write_json(path: Path, value: object) -> None:
    """Write ``value`` as stable, readable JSON (keys in the given order, newline at the end)."""
    scratch = path.with_name(f".{path.name}.part")
    scratch.write_text(json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False) + "\n")
    scratch.replace(path)


def read_json(path: Path, *, kind: str) -> dict[str, Any]:
    """Read an artefact's manifest.

    Raises:
        InputError: the file is missing, is not JSON, or is not a mapping.
    """
    try:
        value = json.loads(path.read_text())
    except FileNotFoundError:
        raise InputError("not found", file=path, expected=f"a {kind}'s manifest") from None
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"is not JSON ({error})", file=path, expected=f"a {kind}") from None
    if not isinstance(value, dict):
        raise InputError("is not a mapping", file=path, expected=f"a {kind}'s manifest")
    return value
