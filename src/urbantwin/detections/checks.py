"""Checks of detections, common to all formats."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from urbantwin.detections.detections import Detections
from urbantwin.errors import InputError
from urbantwin.taxonomy import ACTOR_CLASSES

__all__ = ["checked"]

#: Maximum size and distance of an object, metres.
_LARGEST_M, _FARTHEST_M = 100.0, 1e5
#: Maximum heading, radians: larger values are degrees.
_MOST_YAW = 4 * np.pi


def checked(found: Detections, file: Path) -> Detections:
    """Return valid detections, with headings wrapped to -pi..pi.

    Raises:
        InputError: a number is not finite, a box has no extent or an impossible one, a score is
            outside of 0..1, a heading is in degrees, or a class is unknown.
    """
    _refuse(found, ~np.isfinite(found.box).all(axis=1), "has a box that is not finite", file)
    _refuse(found, ~np.isfinite(found.score), "has a score that is not finite", file)
    outside = (found.score < 0) | (found.score > 1)
    if outside.any():
        worst = found.score[outside][np.abs(found.score[outside]).argmax()]
        _refuse(found, outside, f"has scores like {worst:g}", file, "0 to 1")
    size = found.box[:, 3:6]
    _refuse(found, (size <= 0).any(axis=1), "has a box without extent", file, "sizes above 0 m")
    large = (size > _LARGEST_M).any(axis=1)
    _refuse(found, large, f"has a box of more than {_LARGEST_M:g} m", file, "sizes in metres")
    far = (np.abs(found.box[:, :3]) > _FARTHEST_M).any(axis=1)
    _refuse(found, far, "has a box farther than 100 km", file, "the frame of the points")
    turned = np.abs(found.box[:, 6]) > _MOST_YAW
    if turned.any():
        _refuse(
            found,
            turned,
            f"has a heading of {found.box[turned, 6][0]:g}, as if in degrees",
            file,
            "radians counter-clockwise from +x",
        )
    unknown = np.array([name not in ACTOR_CLASSES for name in found.class_names], bool)
    if unknown.any():
        name = found.class_names[int(unknown.argmax())]
        _refuse(found, unknown, f"class {name!r:.60} is unknown", file, ", ".join(ACTOR_CLASSES))
    box = found.box.copy()
    over = np.abs(box[:, 6]) > np.pi
    box[over, 6] = np.arctan2(np.sin(box[over, 6]), np.cos(box[over, 6]))
    return replace(found, box=box)


def _refuse(
    found: Detections,
    wrong: ArrayLike,
    problem: str,
    file: Path,
    expected: str | None = None,
) -> None:
    rows = np.flatnonzero(wrong)
    if len(rows):
        frame = found.frames[int(found.frame[rows[0]])]
        raise InputError(problem, file=file, place=f"frame {frame}", expected=expected)
