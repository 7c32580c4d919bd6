"""The provenance of a recording: the rig as it was requested, and its files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from urbantwin.artefact import sha256_of
from urbantwin.lidar.background_file import named_background
from urbantwin.site import RigSpec
from urbantwin.twin.provenance import rig_and_files

if TYPE_CHECKING:
    from urbantwin.twin import Twin

__all__ = ["asked_of"]


def asked_of(
    spec: RigSpec, rig_file: Path, twin: Twin, *, background: Sequence[str] = (), fuse: bool = False
) -> dict[str, Any]:
    """Return the requested rig, for ``dataset.json``.

    Args:
        spec: the rig with all changes.
        rig_file: its file.
        twin: the twin.
        background: ``FILE`` or ``NAME=FILE`` of measured backgrounds.
        fuse: use the twin where a background has no range.

    Returns:
        ``rig``, with files named without folders; ``files``: see ``twin.sources``; ``background``:
        ``sensor`` (or ``None``), ``name`` and ``sha256`` of each file; ``fuse``.
    """
    rig, files = rig_and_files(spec.written(), rig_file.parent, twin=twin.folder)
    return {
        "rig": rig,
        "files": files,
        "background": [
            {"sensor": sensor, "name": path.name, "sha256": sha256_of(path)}
            for sensor, path in map(named_background, background)
        ],
        "fuse": fuse,
    }
