"""TUMTraf (formerly A9): clouds of a roadside sensor in pcd, labels in OpenLABEL.

Source: Zimmer et al. 2023, the tum-traffic-dataset-dev-kit, and ASAM OpenLABEL 1.0, 7.13.1: a
cuboid is its centre, a quaternion x, y, z, w (or three Euler angles) and its size along its own
axes. Points and boxes are in the sensor's frame. The first release (Cress et al. 2022: ``_points``
and ``_labels``) came with labels of its own, ``box3d``: the middle, size and yaw in radians (the
kit's first loader, and converters that take half the height off z to reach the floor). What
``urbantwin export --to openlabel`` writes says more of points, by fields of the clouds, and of
boxes, by attributes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from urbantwin.dataset.reading.manifest import pose_of_matrix
from urbantwin.errors import InputError
from urbantwin.fidelity.cloud_formats import read_fields
from urbantwin.fidelity.frame import Boxes, Frame
from urbantwin.fidelity.readers.documents import laid_out, read_json_document
from urbantwin.fidelity.readers.frame_assembly import frame_of
from urbantwin.fidelity.readers.labels import (
    LabelledBox,
    boxes_of,
    heading,
    pose_of_quaternion,
    track_of,
)
from urbantwin.fidelity.readers.plain import clouds_in
from urbantwin.fidelity.readers.recording import Recording
from urbantwin.geometry import Pose

__all__ = ["is_tumtraf", "open_tumtraf", "read_openlabel"]

#: Folders of clouds and of their labels, as the releases name them.
_FOLDERS = {
    "point_clouds": "labels_point_clouds",
    "_points": "_labels",
    "_points_clouds": "_labels",
}
_EXPECTED = "labels in OpenLABEL, or with box3d"
#: The coordinate system of the site in our own exports.
_SITE = "site"
#: Fields of a cloud that mean the same to us as to those who wrote them.
_OURS = ("sensor", "semantic", "instance")


def is_tumtraf(path: Path) -> bool:
    """Return whether a folder has ``point_clouds`` in it, or is a sensor's in one of those."""
    if path.parent.name in _FOLDERS:
        return bool(clouds_in(path, ".pcd"))
    return any(clouds_in(folder, ".pcd") for folder in _sensors(path))


def open_tumtraf(path: Path) -> Recording:
    """Open the clouds of one sensor; labels are found by the names of the clouds.

    Raises:
        InputError: there are several sensors: one of their folders must be named.
    """
    if path.parent.name in _FOLDERS:
        folder = path
    else:
        sensors = _sensors(path)
        if len(sensors) != 1:
            names = ", ".join(sorted(one.name for one in sensors))
            raise InputError(
                f"holds {len(sensors)} sensors",
                file=path,
                expected=f"one of the folders in {sensors[0].parent.name}: {names}",
            )
        folder = sensors[0]
    files = clouds_in(folder, ".pcd")
    labels = _labels(folder)

    def read(index: int) -> Frame:
        file = files[index]
        label = labels / f"{file.stem}.json"
        boxes = _read_labels(label) if label.is_file() else None
        pose = _pose_in_site(label) if boxes is not None else None
        fields = read_fields(file)
        given = {name: fields[name] for name in _OURS if name in fields}
        return frame_of(
            file, fields, name=file.stem, given=given, boxes=boxes, world_SE3_frame=pose
        )

    return Recording(path, "tumtraf", tuple(file.stem for file in files), read)


def _sensors(path: Path) -> list[Path]:
    for folder in (path / name for name in _FOLDERS):
        if folder.is_dir():
            inside = [one for one in folder.iterdir() if one.is_dir() and clouds_in(one, ".pcd")]
            return sorted(inside) or ([folder] if clouds_in(folder, ".pcd") else [])
    return []


def _labels(folder: Path) -> Path:
    """Return where the labels of a folder of clouds are, whether or not it is one of several."""
    if folder.name in _FOLDERS:
        return folder.parent / _FOLDERS[folder.name]
    return folder.parent.parent / _FOLDERS[folder.parent.name] / folder.name


def _read_labels(path: Path) -> Boxes:
    """Read labels of either kind.

    Raises:
        InputError: of neither.
    """
    document = read_json_document(path, _EXPECTED)
    if not (isinstance(document, dict) and isinstance(document.get("labels"), list)):
        return read_openlabel(path)
    labelled = []
    for number, one in enumerate(document["labels"]):
        with laid_out(path, _EXPECTED, place=f"labels[{number}]"):
            told = one["box3d"]
            place, size = told["location"], told["dimension"]
            box = (
                float(place["x"]), float(place["y"]), float(place["z"]),
                float(size["length"]), float(size["width"]), float(size["height"]),
                float(told["orientation"]["rotationYaw"]),
            )  # fmt: skip
            track = track_of(str(one["id"])) if "id" in one else -1
            labelled.append(LabelledBox(box, str(one["category"]), track))
    return boxes_of(labelled)


def _pose_in_site(path: Path) -> Pose | None:
    """Return where the points are in the site, which our own exports alone say.

    TUMTraf's own transforms are not read: its tools take them both ways round.

    Raises:
        InputError: it is no pose.
    """
    document = read_json_document(path, _EXPECTED)
    labels = document.get("openlabel", {}) if isinstance(document, dict) else {}
    with laid_out(path, _EXPECTED):
        if labels.get("coordinate_systems", {}).get(_SITE, {}).get("type") != "scene_cs":
            return None
        for frame in labels["frames"].values():
            for one in frame.get("frame_properties", {}).get("transforms", {}).values():
                if one["dst"] == _SITE:
                    return pose_of_matrix(one["transform_src_to_dst"]["matrix4x4"])
    return None


def read_openlabel(path: Path) -> Boxes:
    """Read the cuboids of a file of one frame, in the frame that they are in.

    Raises:
        InputError: not OpenLABEL, or a cuboid of neither 9 nor 10 values.
    """
    document = read_json_document(path, _EXPECTED)
    with laid_out(path, _EXPECTED):
        labels = document["openlabel"]
        named = labels.get("objects", {})
        labelled = []
        for frame in labels["frames"].values():
            for identity, one in frame.get("objects", {}).items():
                data = one["object_data"]
                name = data.get("type") or named.get(identity, {}).get("type", "")
                labelled += [
                    _labelled(cuboid, str(name), str(identity))
                    for cuboid in _cuboids(data.get("cuboid"))
                ]
        return boxes_of(labelled)


def _labelled(cuboid: Mapping[str, Any], name: str, identity: str) -> LabelledBox:
    known = _attributes(cuboid.get("attributes") or {})
    velocity = known.get("velocity")
    count = known.get("num_points", -1)
    hidden = known.get("occlusion")
    return LabelledBox(
        _box(cuboid["val"]),
        name,
        int(identity) if identity.isascii() and identity.isdigit() else track_of(identity),
        velocity=None if velocity is None else _three(velocity),
        occlusion=math.nan if hidden is None else float(hidden),
        num_points=int(count),
        ignored=str(known.get("ignored") or ""),
    )


def _attributes(by_kind: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of a cuboid's attributes by their names."""
    return {
        str(one["name"]): one["val"]
        for kind in ("num", "text", "vec")
        for one in by_kind.get(kind) or ()
        if "name" in one and "val" in one
    }


def _three(values: Any) -> tuple[float, float, float]:  # noqa: ANN401
    x, y, z = (float(value) for value in values)
    return x, y, z


def _cuboids(value: Any) -> Iterable[Mapping[str, Any]]:  # noqa: ANN401
    """Return an object's cuboids: the standard has a list of them, TUMTraf the one itself."""
    if value is None:
        return ()
    return (value,) if isinstance(value, dict) else value


def _box(values: list[float]) -> tuple[float, float, float, float, float, float, float]:
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
