"""A dataset's frames as a submission to the challenge for synthetic roadside LiDAR."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np

from urbantwin.artefact import check_folder, replaced_folder, write_json
from urbantwin.errors import InputError
from urbantwin.fidelity.challenge import CROP_M, FRAMES, NAME, cropped, read_detections
from urbantwin.fidelity.readers import open_recording
from urbantwin.fidelity.sampling import sample_rows

__all__ = ["MOST_POINTS", "write_challenge"]

#: Most points of a file: 1.5 MB, the challenge's limit.
MOST_POINTS = 125_000


def write_challenge(
    dataset: Path, out: Path, *, frames: int = FRAMES, detections: Path | None = None
) -> list[str]:
    """Write ``synthetic/NNNN.bin`` (float32 N x 3), ``predictions.json`` and ``submission.json``.

    Frames are evenly spread over the dataset, in order, numbered from 0001. Points outside the
    challenge's volume are omitted.

    Args:
        dataset: an UrbanTwin dataset, in the real frames' frame of reference.
        out: folder to write; an older submission is replaced.
        frames: number of frames.
        detections: detections in the challenge's real frames; if not given, ``predictions.json`` is
            omitted, and only realism can be scored.

    Returns:
        Notes for the user.

    Raises:
        InputError: the dataset cannot be read or has too few frames, a frame has no point in that
            volume, the detections are wrong, or ``out`` holds other files.
    """
    check_folder(out, kind="submission", inputs=[dataset, detections])
    recording = open_recording(dataset)
    if len(recording) < frames:
        raise InputError(
            f"has {len(recording)} frames", file=dataset, expected=f"at least {frames}"
        )
    if detections is not None:
        read_detections(detections)
    chosen = np.linspace(0, len(recording) - 1, frames).round().astype(int)
    notes, thinned, names = [], 0, {}
    with replaced_folder(out, kind="submission", inputs=[dataset, detections]) as folder:
        (folder / "synthetic").mkdir()
        for number, index in enumerate(chosen, start=1):
            frame = recording.read(int(index))
            points = cropped(frame.points)
            if not len(points):
                raise InputError(
                    f"frame {frame.name} has no point within {CROP_M} m",
                    file=dataset,
                    expected="points in the sensor's frame",
                )
            if len(points) > MOST_POINTS:
                thinned += 1
                points = points[sample_rows(len(points), MOST_POINTS, seed=number)]
            name = f"{number:04d}"
            (folder / "synthetic" / f"{name}.bin").write_bytes(points.astype("<f4").tobytes())
            names[name] = frame.name
        if detections is not None:
            shutil.copyfile(detections, folder / "predictions.json")
        write_json(
            folder / "submission.json",
            {"kind": "submission", "version": 1, "protocol": NAME, "frames": names},
        )
    if thinned:
        notes.append(f"{thinned} frames were thinned to {MOST_POINTS} points, the most allowed.")
    if detections is None:
        notes.append(
            "There is no predictions.json: the challenge also wants what a detector, trained on "
            "synthetic frames alone, finds in its real frames (--detections)."
        )
    notes.append(
        "The archive to hand in holds synthetic/, predictions.json and the signed declaration, "
        "which is yours to add; submission.json is a note for yourself."
    )
    return notes
