"""A side of what is shown: frames in their order, in the frame of the scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from urbantwin.errors import InputError
from urbantwin.fidelity.frame import Frame
from urbantwin.web.shown_boxes import ShownBoxes

__all__ = ["FrameEntry", "Side", "told_without_folders"]


@dataclass
class FrameEntry:
    """What is known of a frame before it is read.

    Attributes:
        name: of the frame.
        time_s: when it is, seconds.
        points: how many; 0 where nobody counted.
        error: why it cannot be read, one line; None where nothing is known against it.
    """

    name: str
    time_s: float
    points: int = 0
    error: str | None = None


class Side(Protocol):
    """Frames to be shown.

    Attributes:
        name: for people.
        role: ``real``, ``synthetic`` or ``only``.
        rate_hz: frames a second.
        entries: the frames.
        fields: what is told of points, see `points.FIELDS`.
        has_points: whether frames have points.
        has_boxes: whether frames have boxes.
    """

    name: str
    role: str
    rate_hz: float
    entries: Sequence[FrameEntry]
    fields: list[str]
    has_points: bool
    has_boxes: bool

    @property
    def full_scale(self) -> float:
        """The intensity that is shown brightest."""

    def frame(self, index: int) -> Frame:
        """Read a frame, in the frame of the scene.

        Raises:
            InputError: it cannot be read.
        """

    def boxes(self, index: int) -> ShownBoxes:
        """Return the boxes of a frame, in the frame of the scene.

        Raises:
            InputError: they cannot be read.
        """


def told_without_folders(error: InputError, folder: Path) -> str:
    """Return an error as one line in which files are named from a folder on: pages are shared."""
    file = error.file
    if file is not None:
        place = Path(file)
        inside = place.is_relative_to(folder) and place != folder
        file = place.relative_to(folder).as_posix() if inside else place.name
    return str(InputError(error.problem, file=file, place=error.place, expected=error.expected))
