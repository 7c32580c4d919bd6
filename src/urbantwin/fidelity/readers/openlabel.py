"""TUMTraf (formerly A9): clouds of a roadside sensor in pcd, labels in OpenLABEL.

Sources: Zimmer et al. 2023, the tum-traffic-dataset-dev-kit, and ASAM OpenLABEL 1.0, 7.13.1: a
cuboid is its centre, a quaternion x, y, z, w (or three Euler angles) and its size along its own
axes. Points and boxes are in the sensor's frame. The first release (Cress et al. 2022: ``_points``
and ``_labels``) has its own labels, ``box3d``: centre, size and yaw in radians (see the kit's first
loader, and converters that subtract half the height from z to get the bottom). Exports of
``urbantwin export --to openlabel`` have further fields of points and attributes of boxes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from urbantwin.dataset.reading.manifest import pose_of_matrix
from urbantwin.errors import InputError
from urbantwin.fidelity.frame import Boxes
from urbantwin.fidelity.readers.folder import FolderDataset, Labels, clouds_in
from urbantwin.fidelity.readers.labels import Box, LabelledBox, box_of_document, boxes_of, track_of
from urbantwin.geometry import Pose
from urbantwin.io.points import Fields
from urbantwin.io.poses import heading, pose_of_quaternion
from urbantwin.io.trust import laid_out, read_json_document

__all__ = ["TUMTRAF"]

#: Folders of clouds and of their labels in the releases.
_FOLDERS = {
    "point_clouds": "labels_point_clouds",
    "_points": "_labels",
    "_points_clouds": "_labels",
}
_EXPECTED = "labels in OpenLABEL, or with box3d"
#: The coordinate system of the site in our own exports.
_SITE = "site"
#: Fields of a cloud that are attributes of `Frame`.
_OURS = ("sensor", "semantic", "instance")


def _sensor_folders(path: Path) -> list[Path]:
    if path.parent.name in _FOLDERS:
        return [path] if clouds_in(path, ".pcd") else []
    for folder in (path / name for name in _FOLDERS):
        if folder.is_dir():
            inside = [sub for sub in folder.iterdir() if sub.is_dir() and clouds_in(sub, ".pcd")]
            return sorted(inside) or ([folder] if clouds_in(folder, ".pcd") else [])
    return []


def _clouds(path: Path) -> list[Path]:
    sensors = _sensor_folders(path)
    if len(sensors) != 1:
        names = ", ".join(sorted(sensor.name for sensor in sensors))
        raise InputError(
            f"holds {len(sensors)} sensors",
            file=path,
            expected=f"one of the folders in {sensors[0].parent.name}: {names}",
        )
    return clouds_in(sensors[0], ".pcd")


def _label_of(cloud: Path) -> Path:
    """Return the label file of a cloud, in a layout with one sensor or with several."""
    folder = cloud.parent
    if folder.name in _FOLDERS:
        labels = folder.parent / _FOLDERS[folder.name]
    else:
        labels = folder.parent.parent / _FOLDERS[folder.parent.name] / folder.name
    return labels / f"{cloud.stem}.json"


def _labels(path: Path, files: list[Path]) -> Labels:
    def read(file: Path, index: int, fields: Fields) -> dict[str, Any]:
        label = _label_of(file)
        boxes = _read_boxes(label) if label.is_file() else None
        given = {name: fields[name] for name in _OURS if name in fields}
        return {"boxes": boxes, "given": given}

    return Labels(read)


def _read_boxes(path: Path) -> Boxes:
    """Read labels in OpenLABEL or in the format of the first release."""
    document = read_json_document(path, _EXPECTED)
    if not (isinstance(document, dict) and isinstance(document.get("labels"), list)):
        return _read_openlabel(document, path)
    labelled = []
    for number, item in enumerate(document["labels"]):
        with laid_out(path, _EXPECTED, place=f"labels[{number}]"):
            box3d = item["box3d"]
            yaw = box3d["orientation"]["rotationYaw"]
            box = box_of_document(box3d["location"], box3d["dimension"], yaw)
            track = track_of(str(item["id"])) if "id" in item else -1
            labelled.append(LabelledBox(box, str(item["category"]), track))
    return boxes_of(labelled)


def _pose_in_site(path: Path, files: list[Path]) -> Callable[[Path, int], Pose | None]:
    """Return a function of poses in the site frame, which only our own exports contain.

    TUMTraf's own transforms are not read: its tools disagree on their direction.
    """

    def pose(cloud: Path, index: int) -> Pose | None:
        label = _label_of(cloud)
        if not label.is_file():
            return None
        document = read_json_document(label, _EXPECTED)
        labels = document.get("openlabel", {}) if isinstance(document, dict) else {}
        with laid_out(label, _EXPECTED):
            if labels.get("coordinate_systems", {}).get(_SITE, {}).get("type") != "scene_cs":
                return None
            for frame in labels["frames"].values():
                for item in frame.get("frame_properties", {}).get("transforms", {}).values():
                    if item["dst"] == _SITE:
                        return pose_of_matrix(item["transform_src_to_dst"]["matrix4x4"])
        return None

    return pose


def _read_openlabel(document: Any, path: Path) -> Boxes:  # noqa: ANN401 - any JSON
    """Return the cuboids of the document of one frame, in their own coordinate frame."""
    with laid_out(path, _EXPECTED):
        labels = document["openlabel"]
        objects = labels.get("objects", {})
        labelled = []
        for frame in labels["frames"].values():
            for identity, item in frame.get("objects", {}).items():
                data = item["object_data"]
                name = data.get("type") or objects.get(identity, {}).get("type", "")
                labelled += [
                    _labelled(cuboid, str(name), str(identity))
                    for cuboid in _cuboids(data.get("cuboid"))
                ]
        return boxes_of(labelled)


def _cuboids(value: Any) -> Iterable[Mapping[str, Any]]:  # noqa: ANN401
    """Return an object's cuboids: the standard has a list, TUMTraf a single one."""
    if value is None:
        return ()
    return (value,) if isinstance(value, dict) else value


def _labelled(cuboid: Mapping[str, Any], name: str, identity: str) -> LabelledBox:
    by_kind = cuboid.get("attributes") or {}
    attributes = {
        str(item["name"]): item["val"]
        for kind in ("num", "text", "vec")
        for item in by_kind.get(kind) or ()
        if "name" in item and "val" in item
    }
    velocity, occlusion = attributes.get("velocity"), attributes.get("occlusion")
    if velocity is not None:
        x, y, z = (float(value) for value in velocity)
        velocity = x, y, z
    return LabelledBox(
        _box(cuboid["val"]),
        name,
        int(identity) if identity.isascii() and identity.isdigit() else track_of(identity),
        velocity=velocity,
        occlusion=math.nan if occlusion is None else float(occlusion),
        num_points=int(attributes.get("num_points", -1)),
        ignored=str(attributes.get("ignored") or ""),
    )


def _box(values: list[float]) -> Box:
    numbers = np.array(values, np.float64)
    place, size = numbers[:3], numbers[-3:]
    if len(numbers) == 10:
        x, y, z, w = numbers[3:7]
        pose = pose_of_quaternion(w, x, y, z, place)
    elif len(numbers) == 9:
        roll, pitch, yaw = numbers[3:6]
        if not np.isfinite(numbers).all():
            raise ValueError("a cuboid that is not finite")
        pose = Pose.from_ypr(place, yaw, pitch, roll)
    else:
        raise ValueError(f"a cuboid of {len(numbers)} values")
    return (*place.tolist(), *size.tolist(), heading(pose.rotation))


TUMTRAF = FolderDataset(
    name="tumtraf",
    title="TUMTraf",
    detect=lambda path: bool(_sensor_folders(path)),
    clouds=_clouds,
    labels=_labels,
    pose=_pose_in_site,
    verified=False,
)
