"""A side of the page: consecutive frames in the scene's frame."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from urbantwin.errors import InputError
from urbantwin.fidelity.frame import Frame
from urbantwin.web.shown_boxes import ShownBoxes

__all__ = ["FrameEntry", "Side", "told_without_folders"]


@dataclass
class FrameEntry:
    """A frame that has not been read yet.

    Attributes:
        name: name of the frame.
        time_s: time, seconds.
        points: number of points; 0 if unknown.
        error: reason why it cannot be read; None if none is known.
    """

    name: str
    time_s: float
    points: int = 0
    error: str | None = None


class Side(Protocol):
    """Frames to show.

    Attributes:
        name: name for display.
        role: ``real``, ``synthetic`` or ``only``.
        rate_hz: frames per second.
        entries: the frames.
        fields: fields of points, see `points.FIELDS`.
        has_points: whether frames have points.
        has_boxes: whether frames have boxes.
    """

    name: str
    role: str
    rate_hz: float
    entries: list[FrameEntry]
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
    """Return an error as one line with paths relative to a folder, since pages are shared."""
    file = error.file
    if file is not None:
        place = Path(file)
        inside = place.is_relative_to(folder) and place != folder
        file = place.relative_to(folder).as_posix() if inside else place.name
    return str(InputError(error.problem, file=file, place=error.place, expected=error.expected))
