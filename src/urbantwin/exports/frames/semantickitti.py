"""SemanticKITTI: ``sequences/NN`` with ``velodyne``, ``labels``, ``poses.txt`` and ``calib.txt``.

Source: Behley et al. 2019, and semantic-kitti-api (``README.md``, ``generate_sequential.py``). A
sequence is a scene: consecutive frames in one part of the split (`scenes`), since its tools join
frames with previous ones; frames are numbered from 0 in each. ``semantic-kitti.yaml`` is the API's
configuration for this dataset: sequences of training, validation and test, and the fraction of
points of each class.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from urbantwin.dataset.reading import Frame
from urbantwin.exports.frames.scenes import scenes_of
from urbantwin.exports.frames.source import FrameSource
from urbantwin.exports.frames.virtual_camera import PROJECTION, camera_SE3_frame
from urbantwin.geometry import Pose
from urbantwin.progress import Progress
from urbantwin.taxonomy import MOVING, classes_in, kitti_labels, semantic_classes

__all__ = ["MOVING_M_S", "write_semantickitti"]

#: Ground speed above which an actor counts as moving, metres per second.
MOVING_M_S = 0.25
#: The API's names of the parts.
_PARTS = {"train": "train", "val": "valid", "test": "test"}
_LABELS = 1 << 16


def write_semantickitti(source: FrameSource, folder: Path, tell: Progress) -> Sequence[str]:
    """Write a dataset as sequences of SemanticKITTI.

    Args:
        source: the dataset.
        folder: folder to write into.
        tell: called with the fraction done and a description.

    Returns:
        Notes for the user.
    """
    theirs, moving = _numbers()
    counts = np.zeros(_LABELS, np.int64)
    split: dict[str, list[int]] = {name: [] for name in _PARTS.values()}
    told = []
    for number, scene in enumerate(scenes_of(source)):
        frames = scene.numbers
        if scene.part in _PARTS:
            split[_PARTS[scene.part]].append(number)
        place = folder / "sequences" / f"{number:02d}"
        (place / "velodyne").mkdir(parents=True)
        (place / "labels").mkdir()
        first = source[frames[0]]
        camera = camera_SE3_frame(source, first)
        poses, times = [], []
        for at, index in enumerate(frames):
            frame = first if at == 0 else source[index]
            tell(index / len(source), f"frame {frame.name}")
            points = frame.points
            (place / "velodyne" / f"{at:06d}.bin").write_bytes(points.tobytes())
            semantic = np.where(_moves(frame), moving[frame.semantic], theirs[frame.semantic])
            counts += np.bincount(semantic, minlength=_LABELS)
            label = (frame.instance.astype("<u4") << 16) | semantic.astype("<u4")
            (place / "labels" / f"{at:06d}.label").write_bytes(label.astype("<u4").tobytes())
            poses.append(_row(camera @ frame.site_SE3_dataset @ camera.inverse()))
            times.append(f"{frame.time_s:.9f}\n")
        (place / "poses.txt").write_text("".join(poses), encoding="utf-8")
        (place / "times.txt").write_text("".join(times), encoding="utf-8")
        (place / "calib.txt").write_text(_calibration(camera), encoding="utf-8")
        span = f"{source.names[frames[0]]} to {source.names[frames[-1]]}"
        told.append(f"sequence {number:02d}: frames {span}, {scene.part or 'of no part'}")
    (folder / "semantic-kitti.yaml").write_text(_configuration(counts, split), encoding="utf-8")
    return [*told, f"who is faster than {MOVING_M_S} m/s moves; poses are those in the site"]


def _numbers() -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return SemanticKITTI's number of each of our labels, for static and moving; (65536,) each."""
    labels, called = kitti_labels(), classes_in("semantickitti", "point")
    standing, moving = np.zeros(_LABELS, np.int64), np.zeros(_LABELS, np.int64)
    for one in semantic_classes().values():
        name = called.get(one.name)
        if name is not None:
            standing[one.id] = labels[name].id
            moving[one.id] = labels.get(MOVING + name, labels[name]).id
    return standing, moving


def _moves(frame: Frame) -> NDArray[np.bool_]:
    """Return which points (N,) are on a moving actor."""
    speed = np.hypot(frame.objects.velocity[:, 0], frame.objects.velocity[:, 1])
    moving = np.zeros(_LABELS, bool)
    moving[frame.objects.track[speed > MOVING_M_S] % _LABELS] = True
    moving[0] = False
    return np.asarray(moving[frame.instance])


def _row(pose: Pose) -> str:
    matrix = np.column_stack([pose.rotation, pose.translation])
    return " ".join(f"{value + 0.0:.12e}" for value in matrix.ravel()) + "\n"


def _calibration(camera: Pose) -> str:
    lens = " ".join(f"{value:.12e}" for value in PROJECTION.ravel())
    return "".join(f"P{number}: {lens}\n" for number in range(4)) + f"Tr: {_row(camera)}"


def _configuration(counts: NDArray[np.int64], split: dict[str, list[int]]) -> str:
    labels = kitti_labels().values()
    learned = {one.learned: one.id for one in reversed(labels) if one.learned}
    # Buses and trams are learned as other vehicles.
    learned |= {one.learned: one.id for one in labels if one.name == "other-vehicle"}
    inverse = {0: 0} | dict(sorted(learned.items()))
    all_points = max(1, int(counts.sum()))
    content = {
        "name": "urbantwin",
        "labels": {one.id: one.name for one in labels},
        "color_map": {one.id: list(one.colour[::-1]) for one in labels},
        "content": {one.id: float(counts[one.id] / all_points) for one in labels},
        "learning_map": {one.id: one.learned for one in labels},
        "learning_map_inv": inverse,
        "learning_ignore": {number: number == 0 for number in inverse},
        "split": split,
    }
    return yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=100)
