"""nuScenes' results: ``{"results": {sample_token: [{"translation", "size", "rotation", ...}]}}``.

Source: Caesar et al. 2020, the detection task's submission format: boxes in the world, size as
width, length, height, rotation as a quaternion w, x, y, z.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from urbantwin.detections.detections import Detections
from urbantwin.detections.forms.rows import FoundIn, table_of
from urbantwin.errors import InputError
from urbantwin.fidelity.readers import Recording
from urbantwin.fidelity.readers.documents import read_json_document
from urbantwin.fidelity.readers.nuscenes import box_of_row, names_of_samples
from urbantwin.geometry import Pose

__all__ = ["nuscenes_file", "read_nuscenes_json"]

_EXPECTED = "nuScenes' results: translation, size, rotation, detection_name and detection_score"
_NAMES = ("results_nusc.json", "results.json")


def nuscenes_file(path: Path) -> Path | None:
    """Return the file of results that a path is or holds; None where there is none."""
    if path.is_file() and path.suffix == ".json":
        return path
    return next((path / name for name in _NAMES if (path / name).is_file()), None)


def read_nuscenes_json(file: Path, recording: Recording) -> tuple[Detections, tuple[str, ...]]:
    """Read a file of results; see `forms.read_any_form`.

    Samples are those of the recording's tables, or frames by name where it has none.

    Raises:
        InputError: it is not laid out so, is of no frame, or the frames have no place in a world.
    """
    told = read_json_document(file, _EXPECTED)
    results = told.get("results") if isinstance(told, dict) else None
    if not isinstance(results, dict):
        raise InputError("has no results", file=file, expected=_EXPECTED)
    names = {name: name for name in recording.names}
    if recording.layout == "nuscenes":
        names = names_of_samples(recording.path)
    number = {name: index for index, name in enumerate(recording.names)}
    found = []
    for token, rows in results.items():
        if token not in names or names[token] not in number:
            raise InputError(
                "is of no frame",
                file=file,
                place=f"sample {token:.60}",
                expected=f"samples of {recording.path}",
            )
        if not isinstance(rows, list):
            raise InputError(
                "is no list of boxes", file=file, place=f"sample {token:.60}", expected=_EXPECTED
            )
        frame = recording.read(number[names[token]])
        if frame.world_SE3_frame is None:
            raise InputError(
                "is in the world, of which these frames say nothing",
                file=file,
                expected=f"{recording.path} with poses",
            )
        found.append(_found_in(names[token], token, rows, frame.world_SE3_frame.inverse(), file))
    return table_of(sorted(found, key=lambda one: number[one.frame]), file)


def _found_in(
    name: str,
    token: str,
    rows: list[dict[str, Any]],
    frame_SE3_world: Pose,
    file: Path,
) -> FoundIn:
    told = []
    for index, row in enumerate(rows):
        try:
            box = box_of_row(row, frame_SE3_world)
            told.append((box, str(row["detection_name"]), float(row["detection_score"])))
        except (KeyError, TypeError, ValueError):
            raise InputError(
                "is not laid out so",
                file=file,
                place=f"sample {token:.60}, box {index}",
                expected=_EXPECTED,
            ) from None
    return FoundIn.of_rows(name, told)
