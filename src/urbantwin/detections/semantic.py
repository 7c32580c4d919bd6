"""Semantic classes of points beside detections: ``semantic/NAME.label``, as in datasets."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact.document import read_bytes
from urbantwin.errors import InputError

__all__ = ["read_semantic", "write_semantic"]

_FOLDER = "semantic"


def write_semantic(folder: Path, name: str, semantic: NDArray[np.uint8]) -> None:
    """Write the classes of one frame's points.

    Args:
        folder: folder of the detections.
        name: name of the frame.
        semantic: (N,) ids of ``taxonomy.semantic_classes``, in the order in which the points are
            read (without beams that have no return); 0 where unlabelled.
    """
    (folder / _FOLDER).mkdir(exist_ok=True)
    semantic.astype("<u4").tofile(folder / _FOLDER / f"{name}.label")


def read_semantic(folder: Path, name: str, points: int) -> NDArray[np.int64] | None:
    """Return the classes of a frame of ``points`` points; None if the file is missing.

    Raises:
        InputError: the file is of another number of points.
    """
    file = folder / _FOLDER / f"{name}.label"
    if not file.is_file():
        return None
    expected = f"{points} labels of 4 bytes, one for each point of the frame"
    told = read_bytes(file, expected)
    if len(told) != 4 * points:
        raise InputError(f"has {len(told)} bytes", file=file, expected=expected)
    return np.frombuffer(told, "<u4").astype(np.int64) & 0xFFFF
