"""KITTI's object benchmark: ``velodyne``, ``label_2``, ``calib``, ``image_2``, ``ImageSets``.

Source: Geiger et al. 2012, and the development kit's readme. KITTI labels objects in its camera's
view, and trainers keep points within the image only. So ``label_2`` has the boxes in view of a
virtual camera (`virtual_camera`), and ``label_all``, named as in MMDetection3D's Waymo converter,
those on all sides; a box outside of the image has the rectangle 0 0 0 0 there.
"""

from __future__ import annotations

import io
import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from urbantwin.dataset.reading import Frame
from urbantwin.dataset.reading.objects import LabelledObjects
from urbantwin.exports.frames.source import FrameSource
from urbantwin.exports.frames.trainer_folder import left_out, write_splits
from urbantwin.exports.frames.virtual_camera import (
    IMAGE,
    PROJECTION,
    camera_SE3_frame,
    rectangle,
)
from urbantwin.geometry import Pose, wrapped
from urbantwin.progress import Progress
from urbantwin.taxonomy import classes_in

__all__ = ["losses_kitti", "write_kitti"]

#: Occlusion up to which a box is fully, and partly, visible (docs/reference/labels.md).
_VISIBLE, _PARTLY = 0.2, 0.6
_UNKNOWN_LEVEL = 3
_NOWHERE = (0.0, 0.0, 0.0, 0.0)
#: Remaining values of a ``DontCare`` line, from the development kit.
_NO_BOX = "-1 -1 -1 -1000 -1000 -1000 -10"


def losses_kitti(source: FrameSource) -> list[str]:
    """Return notes on losses of this format."""
    return [
        "occlusion is told in KITTI's four levels",
        *left_out(source, "DontCare where the camera sees them, and else left out"),
    ]


def write_kitti(source: FrameSource, folder: Path, tell: Progress) -> Sequence[str]:
    """Write a dataset as KITTI's object benchmark.

    Test frames are written to ``testing``, all others to ``training``.

    Args:
        source: the dataset.
        folder: folder to write into.
        tell: called with the fraction done and a description.

    Returns:
        Notes for the user.
    """
    parts = write_splits(source, folder)
    both = sorted([*parts["train"], *parts["val"]])
    (folder / "ImageSets" / "trainval.txt").write_text(
        "".join(f"{one}\n" for one in both), encoding="utf-8"
    )
    testing = frozenset(parts.get("test", ()))
    picture = _grey_image()
    counted: Counter[str] = Counter()
    for frame in source:
        tell(frame.number / len(source), f"frame {frame.name}")
        place = folder / ("testing" if frame.name in testing else "training")
        for name in ("velodyne", "label_2", "label_all", "calib", "image_2"):
            (place / name).mkdir(parents=True, exist_ok=True)
        points = frame.points
        (place / "velodyne" / f"{frame.name}.bin").write_bytes(points.tobytes())
        camera = camera_SE3_frame(source, frame)
        (place / "calib" / f"{frame.name}.txt").write_text(_calibration(camera), encoding="utf-8")
        (place / "image_2" / f"{frame.name}.png").write_bytes(picture)
        seen, everywhere = _labels(frame, camera, counted)
        (place / "label_2" / f"{frame.name}.txt").write_text(seen, encoding="utf-8")
        (place / "label_all" / f"{frame.name}.txt").write_text(everywhere, encoding="utf-8")
    return [
        f"label_2 has the {counted['seen']} boxes that a virtual camera sees (at the first sensor, "
        f"along x, {IMAGE[0]} x {IMAGE[1]} pixels, KITTI's lens), label_all all {counted['all']}"
    ]


def _calibration(camera_SE3_lidar: Pose) -> str:
    """Return a frame's calibration, with the one camera repeated."""
    turned = np.column_stack([camera_SE3_lidar.rotation, camera_SE3_lidar.translation])
    rows = {f"P{number}": PROJECTION for number in range(4)}
    rows |= {"R0_rect": np.eye(3), "Tr_velo_to_cam": turned, "Tr_imu_to_velo": np.eye(4)[:3]}
    return "".join(
        f"{name}: {' '.join(f'{value:.12e}' for value in values.ravel())}\n"
        for name, values in rows.items()
    )


def _labels(frame: Frame, camera: Pose, counted: Counter[str]) -> tuple[str, str]:
    """Return the labels in view of the camera, and those on all sides.

    Args:
        frame: the frame.
        camera: camera_SE3_frame.
        counted: counts of boxes by treatment, updated.
    """
    boxes, theirs = frame.objects, classes_in("kitti")
    seen, everywhere, regions = [], [], []
    for row in range(len(boxes)):
        name = theirs.get(str(boxes.class_name[row]))
        if not boxes.num_points[row] or name is None:
            continue
        found = rectangle(boxes.box[row], camera)
        if boxes.ignored[row]:
            if found is not None:
                regions.append(f"DontCare -1 -1 -10 {_written(found, 2)} {_NO_BOX}\n")
            continue
        line = _line(name, boxes, row, camera, found or _NOWHERE)
        everywhere.append(line)
        counted["all"] += 1
        if found is not None:
            seen.append(line)
            counted["seen"] += 1
    if not seen and not regions:
        # OpenPCDet's tool fails for a frame without lines, which KITTI does not have: an empty
        # region.
        regions.append(f"DontCare -1 -1 -10 {_written(_NOWHERE, 2)} {_NO_BOX}\n")
    # Readers expect the regions in the last lines.
    return "".join(seen + regions), "".join(everywhere)


def _line(name: str, boxes: LabelledObjects, row: int, camera: Pose, found: Sequence[float]) -> str:
    length, width, height, yaw = boxes.box[row, 3:]
    floor = boxes.box[row, :3] - [0, 0, height / 2]
    x, y, z = camera.apply(floor[None])[0]
    ahead = camera.rotation @ np.array([np.cos(yaw), np.sin(yaw), 0.0])
    turn = math.atan2(-ahead[2], ahead[0])
    alpha = wrapped(turn - math.atan2(x, z))
    values = f"{_written([height, width, length, x, y, z, turn], 4)}"
    level = _level(float(boxes.occlusion[row]))
    return (
        f"{name} {boxes.truncation[row]:.2f} {level} {_written([alpha], 4)} "
        f"{_written(found, 2)} {values}\n"
    )


def _level(occlusion: float) -> int:
    """Return KITTI's level: 0 fully visible, 1 partly, 2 largely occluded, 3 unknown."""
    if math.isnan(occlusion):
        return _UNKNOWN_LEVEL
    return 0 if occlusion <= _VISIBLE else 1 if occlusion <= _PARTLY else 2


def _written(values: Sequence[float], digits: int) -> str:
    """Return numbers as text, without negative zero."""
    return " ".join(f"{round(float(value), digits) + 0.0:.{digits}f}" for value in values)


def _grey_image() -> bytes:
    """Return a grey image for every frame, since readers need an image's size."""
    from PIL import Image

    stream = io.BytesIO()
    Image.new("RGB", IMAGE, (128, 128, 128)).save(stream, "PNG", optimize=True)
    return stream.getvalue()
