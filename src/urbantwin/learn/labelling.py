"""Pseudo-labels: confident detections become labels, doubtful ones are ignored in training.

Detections of a teacher, tracked forwards and backwards through consecutive frames, label the
frames for a student (Caine et al. 2021, "Pseudo-labeling for Scalable 3D Object Detection"; Qi et
al. 2021, "Offboard 3D Object Detection from Point Cloud Sequences").
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from urbantwin.artefact import write_json
from urbantwin.detections import Detections
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.readers.own import LABELLING
from urbantwin.fidelity.readers.recording import Recording
from urbantwin.progress import Progress, each

__all__ = ["DOUBTED", "write_labelled"]

#: Class of ignored labels; no detector has it.
DOUBTED = "doubted"
_RAYS = np.dtype([("sensor", "u1"), ("ring", "u2")])


def write_labelled(
    folder: Path,
    recording: Recording,
    found: Detections,
    *,
    sure: float,
    made_by: dict[str, Any],
    tell: Progress,
) -> dict[str, int]:
    """Write frames with pseudo-labels in the OpenPCDet layout, and the positions of the sensors.

    Args:
        folder: existing folder.
        recording: recording with the frames; its own labels are not read.
        found: detections of these frames, in their order.
        sure: lowest score of a label; boxes with a lower score are `DOUBTED`.
        made_by: provenance of the labels.
        tell: progress callback.

    Returns:
        Number of labels by class.
    """
    for name in ("points", "labels", "rays", "ImageSets"):
        (folder / name).mkdir()
    counts: dict[str, int] = {}
    places = {}
    for number in each(range(len(recording)), tell, "writing"):
        frame = recording.read(number)
        places[frame.name] = frame.sensor_places.tolist()
        _write_points(folder, frame)
        here = found.of(number)
        lines = []
        for box, name, score in zip(here.box, here.class_names, here.score, strict=True):
            told = name if score >= sure else DOUBTED
            counts[told] = counts.get(told, 0) + 1
            lines.append(" ".join(f"{value:.4f}" for value in box) + f" {told}\n")
        (folder / f"labels/{frame.name}.txt").write_text("".join(lines), encoding="utf-8")
    for split in ("train", "val"):
        names = found.frames if split == "train" else ()
        (folder / f"ImageSets/{split}.txt").write_text(
            "".join(f"{one}\n" for one in names), encoding="utf-8"
        )
    write_json(
        folder / LABELLING,
        {"kind": "labelling", "schema": 1, "made_by": made_by, "labels": counts, "sensors": places},
    )
    return counts


def _write_points(folder: Path, frame: Frame) -> None:
    intensity = np.zeros(len(frame.points)) if frame.intensity is None else frame.intensity
    rows = np.column_stack([frame.points, intensity]).astype("f4")
    np.save(folder / f"points/{frame.name}.npy", rows)
    if frame.ring is not None and frame.ring.min(initial=0) >= 0:
        rays = np.zeros(len(rows), _RAYS)
        rays["ring"] = frame.ring
        rays["sensor"] = 0 if frame.sensor is None else frame.sensor
        np.save(folder / f"rays/{frame.name}.npy", rays)
