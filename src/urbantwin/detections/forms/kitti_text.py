"""KITTI's results: a text for each frame, a line for each box, its score last.

Source: the development kit of the object benchmark (Geiger et al. 2012): 15 values as in a label
and the score; boxes are in the rectified frame of the camera, which the calibrations beside the
frames tell.
"""

from __future__ import annotations

from pathlib import Path

from urbantwin.detections.detections import Detections
from urbantwin.detections.forms.rows import FoundIn, table_of
from urbantwin.errors import InputError
from urbantwin.fidelity.readers import Recording
from urbantwin.fidelity.readers.kitti import box_of_values, label_rows, read_calibration

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
    order = {name: number for number, name in enumerate(recording.names)}
    found = []
    for file in _texts(path):
        if file.stem not in order:
            raise InputError("is of no frame", file=file, expected=f"frames of {recording.path}")
        lidar_SE3_camera = read_calibration(calibrations / file.name).camera_SE3_lidar.inverse()
        rows = []
        for number, name, values in label_rows(file, _VALUES):
            if len(values) != _VALUES - 1:
                problem = f"has {len(values) + 1} words"
            elif (values[7:10] <= 0).any() or not 0 <= values[14] <= 1:
                problem = "has a size of 0 m or less, or a score outside of 0 to 1"
            else:
                box = box_of_values(values[7:14], lidar_SE3_camera)
                rows.append((box, name, float(values[14])))
                continue
            raise InputError(problem, file=file, place=f"line {number}", expected=_EXPECTED)
        found.append(FoundIn.of_rows(file.stem, rows))
    return table_of(sorted(found, key=lambda one: order[one.frame]), path)
