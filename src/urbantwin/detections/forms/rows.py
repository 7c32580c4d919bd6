"""Rows of other programs' detections as one table."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.detections.checks import checked
from urbantwin.detections.classes import DETECTED_CLASSES, LARGE, detected_class
from urbantwin.detections.detections import Detections, joined
from urbantwin.errors import InputError
from urbantwin.fidelity.readers.labels import actor_class

__all__ = ["FoundIn", "table_of"]


#: x, y, z of the centre, length, width, height, yaw.
Box = tuple[float, float, float, float, float, float, float]


@dataclass(frozen=True, eq=False)
class FoundIn:
    """What was found in one frame.

    Attributes:
        frame: its name.
        box: (n, 7) in the frame of the points.
        called: (n,) classes as the program calls them.
        score: (n,).
    """

    frame: str
    box: NDArray[np.float64]
    called: Sequence[str]
    score: NDArray[np.float64]

    @classmethod
    def of_rows(cls, frame: str, rows: Sequence[tuple[Box, str, float]]) -> FoundIn:
        """Return boxes, classes and scores that are told row by row."""
        return cls(
            frame,
            np.array([box for box, _, _ in rows], np.float64).reshape(-1, 7),
            [called for _, called, _ in rows],
            np.array([score for _, _, score in rows], np.float64),
        )


def _class_of(called: str) -> str | None:
    """Return a detector's class, or that of another large vehicle, which reports count as such."""
    actor = actor_class(called)
    return detected_class(actor) or (actor if actor in LARGE else None)


def table_of(found: Sequence[FoundIn], file: Path) -> tuple[Detections, tuple[str, ...]]:
    """Return the boxes of classes that detectors have here, and a note of the others.

    Raises:
        InputError: a number cannot be, no class is known, or a frame is there twice.
    """
    twice = [name for name, count in Counter(one.frame for one in found).items() if count > 1]
    if twice:
        raise InputError("has a frame twice", file=file, place=f"frame {twice[0]:.60}")
    others: Counter[str] = Counter()
    rows = []
    for one in found:
        names = [_class_of(name) for name in one.called]
        kept = np.array([name is not None for name in names], bool)
        others.update(name for name, keeps in zip(one.called, kept, strict=True) if not keeps)
        rows.append((one.box[kept], [n for n in names if n is not None], one.score[kept]))
    if others and not any(len(names) for _, names, _ in rows):
        raise InputError(
            f"knows only classes like {min(others)!r:.60}",
            file=file,
            expected=", ".join(DETECTED_CLASSES),
        )
    notes = [
        f"{count} boxes of class {name:.60} are left out." for name, count in sorted(others.items())
    ]
    return checked(joined([one.frame for one in found], rows), file), tuple(notes)
