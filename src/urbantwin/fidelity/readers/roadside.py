"""Data sets with labels in a document per frame or per recording: ONCE, IPS300+, LUMPI, DAIR-V2X.

Sources:

- ONCE: Mao et al. 2021, the documentation of its format, and the once_devkit (``once.py``:
  ``frame_concat``, ``project_boxes_to_image``, issues 20 and 21). In the sensor's frame x is to the
  left, y to the back and z up. A pose is a quaternion x, y, z, w and a position, from the sensor to
  the first sweep's sensor; some sweeps have none. Boxes are centre, length, width, height and yaw.
- IPS300+: Wang et al. 2022, and the IPS300+_dev_kit: ``split_data_generate_txtfile.py`` (JSON:
  centre, size along the heading, yaw counter-clockwise), ``IPS2coco.py`` (order of the text's
  columns) and the reader of its viewer. Labels are in the frame of the first unit's sensor, and so
  are the joint clouds of ``PCD_COM_ROI`` (the viewer draws both with the pose of the first unit's
  camera). The kit makes cars of "Minibus".
- LUMPI: Busch et al. 2022, and the LUMPI SDK's readme and parser. A measurement has its clouds in
  ``lidar``, ten a second and numbered from its start, or in a folder there for each sensor. A line
  of ``Label.csv`` is time in seconds, object, four of an image rectangle, score, class, points,
  then centre, length, width, height in metres and heading in radians, in the frame of the points.
- DAIR-V2X: Yu et al. 2022, and the repository's ``data/README.md``. Roadside points and labels are
  in the virtual LiDAR's frame (x forward, level with the ground).
"""

from __future__ import annotations

import csv
import math
from collections import defaultdict
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.fidelity.frame import Boxes
from urbantwin.fidelity.readers.folder import FolderDataset, Labels, clouds_in
from urbantwin.fidelity.readers.labels import LabelledBox, box_of_document, boxes_of
from urbantwin.geometry import Pose
from urbantwin.io.points import Fields
from urbantwin.io.poses import checked_pose, pose_of_quaternion
from urbantwin.io.trust import (
    finite_numbers,
    laid_out,
    read_json_document,
    read_lines,
)

__all__ = ["DAIR_V2X", "IPS300", "LUMPI", "ONCE"]

# -- ONCE

_ONCE = "a sequence of ONCE"


def _once_labels(path: Path, files: list[Path]) -> Labels:
    """Return the reader of boxes and poses from the sequence's JSON, named as its folder."""
    document = path / f"{path.absolute().name}.json"
    others = sorted(path.glob("*.json"))
    if not document.is_file() and len(others) == 1:
        document = others[0]  # the folder was renamed
    frames: dict[str, Mapping[str, Any]] = {}
    if document.is_file():
        with laid_out(document, _ONCE):
            listed = read_json_document(document, _ONCE)["frames"]
            if not isinstance(listed, list):
                raise TypeError("frames are no list")
        for number, frame in enumerate(listed):
            place = f"frames[{number}]"
            with laid_out(document, _ONCE, place=place):
                name = str(frame["frame_id"])
                if name in frames:
                    raise InputError(f"has frame {name} twice", file=document, place=place)
                frames[name] = {"pose": frame.get("pose"), "annos": frame.get("annos")}

    def read(file: Path, index: int, fields: Fields) -> dict[str, Any]:
        frame = frames.get(file.stem, {})
        with laid_out(document, _ONCE, place=f"frame {file.stem}"):
            boxes, pose = _once_boxes(frame.get("annos")), _once_pose(frame.get("pose"))
        return {"boxes": boxes, "world_SE3_frame": pose}

    missing = len(frames.keys() - {file.stem for file in files})
    notes = (f"{missing} of {len(frames)} sweeps are not there.",) if missing else ()
    return Labels(read, notes)


def _once_boxes(annotations: Mapping[str, Any] | None) -> Boxes | None:
    if annotations is None or "names" not in annotations:
        return None
    labelled = []
    for name, box in zip(annotations["names"], annotations["boxes_3d"], strict=True):
        x, y, z, length, width, height, yaw = (float(value) for value in box)
        labelled.append(LabelledBox((x, y, z, length, width, height, yaw), str(name)))
    return boxes_of(labelled)


def _once_pose(values: list[float] | None) -> Pose | None:
    """Return a pose, None if the sweep has no value, or only zeros."""
    numbers = np.asarray([] if values is None else values, np.float64)
    if not numbers.any():
        return None
    x, y, z, w, *place = numbers.tolist()
    return pose_of_quaternion(w, x, y, z, place)


ONCE = FolderDataset(
    name="once",
    title="ONCE",
    detect=lambda path: bool(clouds_in(path / "lidar_roof", ".bin")),
    clouds=lambda path: clouds_in(path / "lidar_roof", ".bin"),
    labels=_once_labels,
    verified=False,
    notes=("The sensor's frame has x to the left and y to the back.",),
)

# -- IPS300+

_IPS300 = "labels of IPS300+"
#: Folders of clouds in ``data``, and the suffix of their files' names: of both units, of the first.
_JOINT = "PCD_COM_ROI"
_ENDINGS = {_JOINT: "_COM_ROI", "IPU1_pcd": "_IPU1_LIDAR"}
#: Words of a line: class, three of occlusion and angle, two rectangles of four, then height, width,
#: length, centre and yaw.
_IPS300_WORDS = 19


def _ips300_folder(path: Path) -> Path | None:
    """Return the folder of clouds: a path itself, or the joint ones of the set or its ``data``."""
    for folder in (path.absolute(), path / _JOINT, path / "data" / _JOINT):
        if folder.name in _ENDINGS and clouds_in(folder, ".pcd"):
            return folder
    return None


def _ips300_clouds(path: Path) -> list[Path]:
    folder = _ips300_folder(path)
    if folder is None:
        raise InputError("holds no clouds", file=path, expected=f"data/{_JOINT}/*.pcd")
    return clouds_in(folder, ".pcd")


def _ips300_labels(path: Path, files: list[Path]) -> Labels:
    """Return the reader of boxes from ``label/json``, or from ``label/txt`` for missing frames."""
    folder = files[0].parent
    labels = [above / "label" for above in folder.absolute().parents[:3]]

    def read(file: Path, index: int, fields: Fields) -> dict[str, Any]:
        name = f"{file.stem.removesuffix(_ENDINGS[folder.name])}_LABEL"
        for kind, parse in (("json", _ips300_json), ("txt", _ips300_text)):
            for label in labels:
                if (document := label / kind / f"{name}.{kind}").is_file():
                    return {"boxes": parse(document)}
        return {}

    note = (
        "Points of both units are in the first one's frame; the second unit's place is not given."
    )
    return Labels(read, (note,) if folder.name == _JOINT else ())


def _ips300_json(path: Path) -> Boxes:
    with laid_out(path, _IPS300):
        objects = read_json_document(path, _IPS300)["objects"]
        if not isinstance(objects, list):
            raise TypeError("objects are no list")
    labelled = []
    for number, item in enumerate(objects):
        with laid_out(path, _IPS300, place=f"objects[{number}]"):
            box = box_of_document(item["center"], item["dimensions"], item["rotation"]["z"])
            labelled.append(LabelledBox(box, str(item["label"])))
    return boxes_of(labelled)


def _ips300_text(path: Path) -> Boxes:
    labelled = []
    for number, line in enumerate(read_lines(path, _IPS300), 1):
        words = line.split()
        if not words or words[0] == "DontCare":
            continue
        try:
            if len(words) != _IPS300_WORDS:
                raise ValueError(f"{len(words)} values")
            height, width, length, x, y, z, yaw = finite_numbers(words[12:])
        except ValueError as error:
            raise InputError(
                f"is no label ({error})",
                file=path,
                place=f"line {number}",
                expected=f"a class and {_IPS300_WORDS - 1} numbers of IPS300+",
            ) from None
        labelled.append(LabelledBox((x, y, z, length, width, height, yaw), words[0]))
    return boxes_of(labelled)


IPS300 = FolderDataset(
    name="ips300",
    title="IPS300+",
    detect=lambda path: _ips300_folder(path) is not None,
    clouds=_ips300_clouds,
    labels=_ips300_labels,
    verified=False,
    classes={"minibus": "car"},
)

# -- LUMPI

_LABELS = "Label.csv"
_FRAMES_PER_SECOND = 10
#: Classes by number; files with a class 7 have vans at 6.
_CLASSES = ("person", "car", "bicycle", "motorcycle", "bus", "truck", "unknown")
_WITH_VANS = (*_CLASSES[:6], "van", "unknown")
_COLUMNS = 16
#: Bound of times, object numbers and coordinates of a measurement.
_LARGEST = 2.0**53
_LUMPI_NOTE = "Where the sensors are is not in the clouds: ranges are from the frame's origin."


def _measurement(path: Path) -> Path | None:
    """Return the folder with the labels: the given one, or one or two above it."""
    folders = (path, path.parent, path.parent.parent)
    return next((folder for folder in folders if (folder / _LABELS).is_file()), None)


def _lumpi_folders(path: Path) -> list[Path]:
    """Return the folders with clouds of a measurement."""
    lidar = path / "lidar"
    for folder in (path, lidar):
        if clouds_in(folder, ".ply"):
            return [folder]
    if not lidar.is_dir():
        return []
    return sorted(sub for sub in lidar.iterdir() if sub.is_dir() and clouds_in(sub, ".ply"))


def _lumpi_clouds(path: Path) -> list[Path]:
    folders = _lumpi_folders(path)
    if len(folders) != 1:
        raise InputError(
            f"holds {len(folders)} sensors",
            file=path,
            expected=f"one of the folders in it: {', '.join(folder.name for folder in folders)}",
        )
    return clouds_in(folders[0], ".ply")


def _lumpi_labels(path: Path, files: list[Path]) -> Labels:
    measurement = _measurement(path)
    assert measurement is not None
    labelled = _lumpi_table(measurement / _LABELS)
    sessions = _sessions(measurement)
    numbered = all(file.stem.isdigit() for file in files)

    def read(file: Path, index: int, fields: Fields) -> dict[str, Any]:
        boxes = boxes_of(labelled.get(int(file.stem) if numbered else index, []))
        given = {"sensor": _sensor_of(fields["id"], sessions)} if "id" in fields else {}
        return {"boxes": boxes, "given": given, "notes": (_LUMPI_NOTE,)}

    return Labels(read, (_LUMPI_NOTE,))


def _sessions(measurement: Path) -> list[list[int]]:
    """Return the numbers of the LiDAR sessions of each measurement by ``meta.json``, if any."""
    files = (folder / "meta.json" for folder in (measurement, measurement.parent))
    file = next((file for file in files if file.is_file()), None)
    if file is None:
        return []
    expected = "sessions of LUMPI"
    by_measurement: dict[str, list[int]] = defaultdict(list)
    document = read_json_document(file, expected)
    with laid_out(file, expected):
        for number, session in document.get("session", {}).items():
            if session.get("type") == "lidar":
                by_measurement[str(session.get("experimentId"))].append(int(number))
    return [sorted(numbers) for numbers in by_measurement.values()]


def _sensor_of(identity: NDArray[np.generic], sessions: list[list[int]]) -> NDArray[np.int64]:
    """Return the rank of each point's session among those of its measurement.

    If no measurement lists them, it is the rank among the sessions in the cloud.
    """
    present, place = np.unique(identity, return_inverse=True)
    listed = next((numbers for numbers in sessions if np.isin(present, numbers).all()), None)
    ranks: NDArray[np.int64] = np.arange(len(present), dtype=np.int64)
    if listed is not None:
        ranks = np.asarray(np.searchsorted(np.array(listed), present), np.int64)
    return np.asarray(ranks[place.ravel()])


def _lumpi_table(path: Path) -> dict[int, list[LabelledBox]]:
    """Return the objects by frame number, from their time."""
    rows = []
    expected = f"{_COLUMNS} numbers of LUMPI"
    with laid_out(path, expected):
        try:
            table = list(csv.reader(read_lines(path, expected)))
        except csv.Error as error:
            raise InputError(f"is not a table ({error})", file=path, expected=expected) from None
        for number, row in enumerate(table, 1):
            if not row or (number == 1 and not _is_number(row[0])):
                continue  # a line of names
            try:
                values = finite_numbers(value.strip() for value in row[:_COLUMNS])
                if len(values) < _COLUMNS or max(map(abs, values)) > _LARGEST:
                    raise ValueError
            except ValueError:
                raise InputError(
                    "is not a LUMPI label", file=path, place=f"line {number}", expected=expected
                ) from None
            rows.append(values)
    classes = _WITH_VANS if any(values[7] == len(_CLASSES) for values in rows) else _CLASSES
    by_frame: dict[int, list[LabelledBox]] = defaultdict(list)
    for values in rows:
        kind = int(values[7])
        name = classes[kind] if 0 <= kind < len(classes) else "unknown"
        x, y, z, length, width, height, yaw = values[9:_COLUMNS]
        # 0.3 s times 10 may be slightly less than 3
        frame = math.floor(values[0] * _FRAMES_PER_SECOND + 1e-6)
        box = (x, y, z, length, width, height, yaw)
        count = max(int(values[8]), -1)
        by_frame[frame].append(LabelledBox(box, name, int(values[1]), num_points=count))
    return dict(by_frame)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


LUMPI = FolderDataset(
    name="lumpi",
    title="LUMPI",
    detect=lambda path: (
        path.is_dir() and _measurement(path) is not None and bool(_lumpi_folders(path))
    ),
    clouds=_lumpi_clouds,
    labels=_lumpi_labels,
    verified=False,
)

# -- DAIR-V2X

#: Folders of labels at the time of the points; those in ``camera`` are at the image's.
_DAIR_LABELS = ("label/virtuallidar", "label/lidar")


def _dair_labels(path: Path, files: list[Path]) -> Labels:
    def read(file: Path, index: int, fields: Fields) -> dict[str, Any]:
        documents = (path / folder / f"{file.stem}.json" for folder in _DAIR_LABELS)
        document = next((each for each in documents if each.is_file()), None)
        if document is None:
            return {}
        expected = "labels of DAIR-V2X"
        with laid_out(document, expected):
            labelled = [
                LabelledBox(
                    box_of_document(
                        item["3d_location"], item["3d_dimensions"], item["rotation"], "lwh"
                    ),
                    str(item["type"]),
                    int(item.get("track_id", -1)),
                )
                for item in read_json_document(document, expected)
            ]
            return {"boxes": boxes_of(labelled)}

    return Labels(read)


def _dair_pose(path: Path, files: list[Path]) -> Callable[[Path, int], Pose | None]:
    def pose(cloud: Path, index: int) -> Pose | None:
        file = path / "calib" / "virtuallidar_to_world" / f"{cloud.stem}.json"
        if not file.is_file():
            return None
        expected = "rotation and translation"
        with laid_out(file, expected):
            values = read_json_document(file, expected)
            values = values.get("transform", values)
            return checked_pose(values["rotation"], values["translation"])

    return pose


DAIR_V2X = FolderDataset(
    name="dair-v2x",
    title="DAIR-V2X",
    detect=lambda path: (
        bool(clouds_in(path / "velodyne", ".pcd"))
        and (
            any((path / folder).is_dir() for folder in _DAIR_LABELS)
            or (path / "data_info.json").is_file()
        )
    ),
    clouds=lambda path: clouds_in(path / "velodyne", ".pcd"),
    labels=_dair_labels,
    pose=_dair_pose,
    verified=False,
)
