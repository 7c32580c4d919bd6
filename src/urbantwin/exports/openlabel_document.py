"""Common structure of ASAM OpenLABEL 1.0.0 documents."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

__all__ = ["openlabel_document", "write_openlabel_file"]


def openlabel_document(
    name: str,
    *,
    coordinate_systems: Mapping[str, Any],
    objects: Mapping[str, Any],
    frames: Mapping[str, Any],
    **more: Mapping[str, Any],
) -> dict[str, Any]:
    """Return a document.

    Args:
        name: name of the labelled data, for display.
        coordinate_systems: coordinate systems by name.
        objects: name and type of each object, by its number as text.
        frames: content of each frame, by its number as text.
        more: further tables of the standard, by name.
    """
    return {
        "openlabel": {
            "metadata": {"schema_version": "1.0.0", "name": name},
            "coordinate_systems": dict(coordinate_systems),
            **more,
            "frame_intervals": _intervals(sorted(map(int, frames))),
            "objects": dict(objects),
            "frames": dict(frames),
        }
    }


def _intervals(numbers: Sequence[int]) -> list[dict[str, int]]:
    """Return the first and the last of every run of numbers, which grow."""
    starts = [one for at, one in enumerate(numbers) if not at or numbers[at - 1] != one - 1]
    ends = [
        one for at, one in enumerate(numbers, 1) if at == len(numbers) or numbers[at] != one + 1
    ]
    return [
        {"frame_start": first, "frame_end": last} for first, last in zip(starts, ends, strict=True)
    ]


def write_openlabel_file(path: Path, document: Mapping[str, Any]) -> None:
    """Write a document without blanks."""
    text = json.dumps(document, separators=(",", ":"), allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")
