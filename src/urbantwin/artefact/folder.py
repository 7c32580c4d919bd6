"""Folders that appear whole or not at all."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from urbantwin.errors import InputError

__all__ = ["replaced_folder"]


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
