"""KITTI's results: a text for each frame, a line for each box, its score last.

Source: the development kit of the object benchmark (Geiger et al. 2012): 15 values as in a label
and the score; boxes are in the rectified frame of the camera, which the calibrations beside the
frames tell.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from urbantwin.detections.detections import Detections
from urbantwin.detections.forms.rows import FoundIn, table_of
from urbantwin.errors import InputError
from urbantwin.fidelity.readers import Recording
from urbantwin.fidelity.readers.documents import finite_numbers, read_lines
from urbantwin.fidelity.readers.kitti import box_of_values, read_calibration

__all__ = ["is_kitti_text", "read_kitti_text"]

_VALUES = 16
_EXPECTED = "16 values of KITTI: class, 14 numbers of a label, score"


def _texts(path: Path) -> list[Path]:
    """Return the texts of a folder, or of ``data`` in it, as KITTI's own programs write them."""
    for folder in (path, path / "data"):
        found = sorted(folder.glob("*.txt")) if folder.is_dir() else []
        if found:
            return found
    return []


def is_kitti_text(path: Path) -> bool:
    """Return whether a folder holds texts."""
    return bool(_texts(path))


def read_kitti_text(path: Path, recording: Recording) -> tuple[Detections, tuple[str, ...]]:
    """Read a folder of texts; see `forms.read_any_form`.

    A frame without a text was not looked at; one with an empty text holds nothing.

    Raises:
        InputError: a line is not right, or the recording has no calibrations.
    """
    calibrations = recording.path / "calib"
    if recording.layout != "kitti" or not calibrations.is_dir():
        raise InputError(
            "is in the frame of KITTI's camera, of which these frames say nothing",
            file=path,
            expected=f"{recording.path} with calib/, as KITTI has it",
        )
    found = []
    for file in _texts(path):
        if file.stem not in recording.names:
            raise InputError("is of no frame", file=file, expected=f"frames of {recording.path}")
        lidar_SE3_camera = read_calibration(calibrations / file.name).camera_SE3_lidar.inverse()
        boxes, called, scores = [], [], []
        for number, line in enumerate(read_lines(file, _EXPECTED), 1):
            words = line.split()
            if not words or words[0] == "DontCare":
                continue
            try:
                values = np.array(finite_numbers(words[1:]))
                if len(words) != _VALUES:
                    raise ValueError
            except ValueError:
                raise InputError(
                    f"has {len(words)} words, or one that is no number",
                    file=file,
                    place=f"line {number}",
                    expected=_EXPECTED,
                ) from None
            if (values[7:10] <= 0).any() or not 0 <= values[14] <= 1:
                raise InputError(
                    "has a size of 0 m or less, or a score outside of 0 to 1",
                    file=file,
                    place=f"line {number}",
                    expected=_EXPECTED,
                )
            boxes.append(box_of_values(values[7:14], lidar_SE3_camera))
            called.append(words[0])
            scores.append(values[14])
        box = np.array(boxes, np.float64).reshape(-1, 7)
        found.append(FoundIn(file.stem, box, called, np.array(scores, np.float64)))
    order = {name: number for number, name in enumerate(recording.names)}
    return table_of(sorted(found, key=lambda one: order[one.frame]), path)
