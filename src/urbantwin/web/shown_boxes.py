"""Boxes of a frame as listed on the page."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.fidelity.frame import Boxes
from urbantwin.web.packet import packet

__all__ = ["ShownBoxes", "boxes_packet"]


@dataclass(eq=False)
class ShownBoxes:
    """Boxes (B) of a frame, in the scene's frame; unknown columns are None.

    Attributes:
        box: (B, 7) centre, length, width, height in metres, yaw in radians.
        class_names: (B,) class names of the data.
        track: (B,) int64, -1 for objects without a track.
        velocity: (B, 3) metres per second; NaN if unknown.
        points: (B,) number of points; -1 if unknown.
        alone: (B,) number of points without occlusion by other objects.
        occlusion: (B,) 0..1, NaN if unknown.
        truncation: (B,) 0..1, NaN if unknown.
        difficulty: (B,) ``easy``, ``moderate``, ``hard`` or empty.
        ignored: (B,) reason why a box does not count, or empty.
        hidden_by: (B,) occluding tracks; None if not computed.
        why: (B,) sentence why an object is not seen, or empty.
        score: (B,) scores of detections; NaN for labels.
        verdict: (B,) ``hit``, ``miss``, ``false alarm`` or empty.
        match: (B,) row of the label matched by a detection, or -1.
    """

    box: NDArray[np.float64]
    class_names: list[str]
    track: NDArray[np.int64]
    velocity: NDArray[np.float64] | None = None
    points: NDArray[np.int64] | None = None
    alone: NDArray[np.int64] | None = None
    occlusion: NDArray[np.float64] | None = None
    truncation: NDArray[np.float64] | None = None
    difficulty: list[str] | None = None
    ignored: list[str] | None = None
    hidden_by: list[list[int] | None] = field(default_factory=list)
    why: list[str] = field(default_factory=list)
    score: NDArray[np.float64] | None = None
    verdict: list[str] | None = None
    match: NDArray[np.int64] | None = None

    def __len__(self) -> int:
        """Return the number of boxes."""
        return len(self.box)

    @classmethod
    def of(cls, boxes: Boxes | None) -> ShownBoxes:
        """Return the boxes of a reader."""
        if boxes is None:
            return cls(np.zeros((0, 7)), [], np.zeros(0, np.int64))
        named = boxes.source_names or boxes.class_names
        return cls(
            box=boxes.box,
            class_names=[
                theirs if ours == "other" else ours
                for ours, theirs in zip(boxes.class_names, named, strict=True)
            ],
            track=boxes.track,
            velocity=boxes.velocity,
            points=boxes.num_points,
            occlusion=boxes.occlusion,
            ignored=None if boxes.ignored is None else list(boxes.ignored),
        )

    def rows(self) -> list[dict[str, Any]]:
        """Return rows for the packet's header: plain values, None if unknown."""
        return [self._row(index) for index in range(len(self))]

    def _row(self, index: int) -> dict[str, Any]:
        def number(values: NDArray[Any] | None, digits: int) -> float | None:
            value = math.nan if values is None else float(values[index])
            return round(value, digits) if math.isfinite(value) else None

        def word(values: list[str] | None) -> str | None:
            return (values[index] or None) if values else None

        def rounded(values: NDArray[Any] | None, digits: int) -> list[float] | None:
            if values is None or not np.isfinite(values[index]).all():
                return None
            return [round(float(one), digits) for one in values[index]]

        points = -1 if self.points is None else int(self.points[index])
        row = {
            "track": int(self.track[index]),
            "class": self.class_names[index],
            "box": rounded(self.box, 4),
            "velocity": rounded(self.velocity, 3),
            "points": points if points >= 0 else None,
            "occlusion": number(self.occlusion, 4),
            "truncation": number(self.truncation, 4),
            "difficulty": word(self.difficulty),
            "ignored": word(self.ignored),
            "hidden_by": self.hidden_by[index] if self.hidden_by else None,
            "why": word(self.why),
            "score": number(self.score, 4),
            "verdict": word(self.verdict),
        }
        if self.match is not None and self.match[index] >= 0:
            row["match"] = int(self.match[index])
        return row


def boxes_packet(boxes: ShownBoxes) -> bytes:
    """Return the packet of a frame's boxes."""
    return packet({"boxes": boxes.rows()}, {})
