"""Artefacts: folders on disk that appear whole or not at all, and the JSON beside them."""

from __future__ import annotations

import hashlib
import json
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from urbantwin.errors import InputError

__all__ = ["read_json", "replaced_folder", "sha256_of", "write_json"]


@contextmanager
def replaced_folder(target: Path, *, kind: str) -> Iterator[Path]:
    """Yield an empty folder beside ``target`` that takes its place when the block succeeds.

    When the block fails, ``target`` stays as it was and nothing half-written is left.

    Args:
        target: the folder to write. An older artefact of the same kind is replaced.
        kind: the artefact's kind; its manifest is ``KIND.json``. A non-empty folder
            without that manifest is somebody's own and is never replaced.

    Raises:
        InputError: ``target`` is a file, or a folder that holds something else.
    """
    if target.exists():
        if not target.is_dir():
            raise InputError("is a file", file=target, expected=f"a folder for the {kind}")
        if any(target.iterdir()) and not (target / f"{kind}.json").exists():
            raise InputError(
                "holds other files, which would be lost",
                file=target,
                expected=f"a new or empty folder, or an older {kind}",
            )
    target.parent.mkdir(parents=True, exist_ok=True)
    scratch = Path(tempfile.mkdtemp(prefix=f".{target.name}-", dir=target.parent))
    try:
        yield scratch
        scratch.chmod(0o755)
        if target.exists():
            shutil.rmtree(target)
        scratch.replace(target)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


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


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file's bytes, in hexadecimal."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
