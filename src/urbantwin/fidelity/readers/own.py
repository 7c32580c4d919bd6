"""Our own datasets and fleets: points, labels per point, boxes, rays, and sensor positions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from urbantwin.artefact import read_json
from urbantwin.artefact.document import read_bytes
from urbantwin.artefact.manifest import Part, validated
from urbantwin.dataset import parts_of
from urbantwin.dataset.reading import Fleet
from urbantwin.dataset.reading.columns import POINT
from urbantwin.dataset.reading.frame_files import FrameFiles, stored_frames
from urbantwin.dataset.reading.manifest import FramePoses, pose_of_matrix
from urbantwin.dataset.reading.objects import LabelledObjects
from urbantwin.dataset.reading.turns import SensorTurns
from urbantwin.errors import InputError
from urbantwin.fidelity.clouds import counting_order
from urbantwin.fidelity.frame import Boxes, Frame
from urbantwin.fidelity.readers.folder import clouds_in
from urbantwin.fidelity.readers.frame_assembly import frame_of
from urbantwin.fidelity.readers.labels import LabelledBox, boxes_of
from urbantwin.fidelity.readers.recording import Recording
from urbantwin.geometry import Pose
from urbantwin.io.points import Fields, read_fields
from urbantwin.io.trust import finite_numbers
from urbantwin.reconstruct.recording import RecordedFrames
from urbantwin.taxonomy import ACTOR_CLASSES

__all__ = ["LABELLING", "is_fleet", "is_own", "open_fleet", "open_own", "with_lost_turns"]

#: File with the sensor positions of frames that a model labelled.
LABELLING = "labelling.json"

_Metres = Annotated[float, Field(ge=-1e6, le=1e6)]
_Table = TypeVar("_Table", LabelledObjects, SensorTurns)
_RAYS = {"sensor": "sensor", "ring": "ring", "column": "column", "time": "time_s"}
_EXPECTED = "a dataset of urbantwin record"


def is_own(path: Path) -> bool:
    """Return whether a folder is one of our datasets."""
    if clouds_in(path / "points", ".npy"):
        return True
    labelled = any((path / "labels").glob("*.txt"))
    if labelled and clouds_in(path / "points", ".bin"):  # MMDetection3D's custom dataset
        return True
    manifest = path / "dataset.json"  # other programs use this name, too
    return manifest.is_file() and b'"kind": "dataset' in read_bytes(manifest, _EXPECTED)


def with_lost_turns(recording: Recording) -> Recording:
    """Return a dataset of ours including frames without points, whose data were all lost.

    Detections are evaluated on these frames as well; point clouds are compared without them.

    Args:
        recording: of any layout; other layouts than ours are returned unchanged.
    """
    if recording.layout != "own" or not SensorTurns.is_in(recording.path):
        return recording
    opens = partial(open_own, recording.path, None, may_be_empty=True)
    return replace(opens(), again=opens)


def open_own(path: Path, columns: int | None, *, may_be_empty: bool = False) -> Recording:
    """Open a dataset of ``urbantwin record``.

    Attributes whose files are missing (labels, rays) are None.

    Args:
        path: the folder.
        columns: values per row of ``.bin`` files.
        may_be_empty: whether frames without points are included.

    Raises:
        InputError: no points, or a folder with one dataset per sensor.
    """
    manifest = {}
    if (path / "dataset.json").is_file():
        manifest = read_json(path / "dataset.json", kind="dataset")
        if manifest.get("kind") == "datasets":
            names = ", ".join(one.name for one in parts_of(path))
            raise InputError("holds a dataset for each sensor", file=path, expected=f"one: {names}")
    files = clouds_in(path / "points")
    in_columns = manifest.get("storage", "npy") != "npy"
    if in_columns:
        kept = [FrameFiles(path, name).file for name in stored_frames(path)]
        files = sorted(kept, key=counting_order)
    if not files:
        raise InputError("holds no points", file=path / "points", expected=_EXPECTED)
    file = path / "dataset.json"
    poses = _poses(validated(manifest, FramePoses, file=file, expected=_EXPECTED))
    turns = _read_once(SensorTurns, path)
    discovered = None
    if (path / "discovery.json").is_file():
        discovered = np.array([sensor.place for sensor in RecordedFrames(path).sensors])
    labelled = _labelled_places(path / LABELLING)
    labels = _read_once(LabelledObjects, path)

    def read(index: int) -> Frame:
        file = files[index]
        name = file.stem
        lines = path / "labels" / f"{name}.txt"
        kept = FrameFiles(path, name)
        fields = kept.fields if in_columns else read_fields(file, columns)
        dataset_SE3_site = poses.get(name, poses.get(""))
        seen_from = labelled.get(name, discovered)
        if dataset_SE3_site is not None:
            known = turns()
            seen_from = None if known is None else sensor_places(known, name, dataset_SE3_site)
        objects = labels()
        return frame_of(
            file,
            fields,
            name=name,
            given=_given(kept),
            may_be_empty=may_be_empty,
            boxes=boxes_of_objects(objects.of_frame(name))
            if objects is not None
            else read_label_lines(lines),
            world_SE3_frame=None if dataset_SE3_site is None else dataset_SE3_site.inverse(),
            sensor_places=np.zeros((1, 3)) if seen_from is None else seen_from,
        )

    return Recording(path, "own", tuple(file.stem for file in files), read)


def _read_once(kind: type[_Table], path: Path) -> Callable[[], _Table | None]:
    """Return a cached function that reads a table, or returns None if there is none."""
    return cache(lambda: kind.in_folder(path) if kind.is_in(path) else None)


def _given(files: FrameFiles) -> Fields:
    """Return the attributes of points from the files of rays and labels, if they exist."""
    given: Fields = {}
    if (rays := files.known_rays) is not None:
        given |= fields_of_rays(rays)
    if (code := files.known_labels) is not None:
        given |= {"semantic": code & 0xFFFF, "instance": code >> 16}
    return given


def fields_of_rays(table: NDArray[np.void]) -> Fields:
    """Return the fields of rays, named as the attributes of a frame."""
    return {_RAYS[field]: table[field] for field in table.dtype.names or () if field in _RAYS}


def read_label_lines(path: Path) -> Boxes | None:
    """Return the boxes of an OpenPCDet label file, or None if it is missing.

    Lines are ``x y z dx dy dz heading class``.

    Raises:
        InputError: a line is invalid.
    """
    if not path.is_file():
        return None
    labelled, byte = [], 0
    for number, raw in enumerate(read_bytes(path, "labels").splitlines(keepends=True), 1):
        words, begin = raw.decode(errors="replace").split(), byte
        byte += len(raw)
        if not words:
            continue
        try:
            x, y, z, length, width, height, yaw = finite_numbers(words[:7])
            name = words[7]
        except (ValueError, IndexError):
            raise InputError(
                "is not an OpenPCDet label",
                file=path,
                place=f"line {number} (byte {begin})",
                expected="x y z dx dy dz heading class",
            ) from None
        labelled.append(LabelledBox((x, y, z, length, width, height, yaw), name))
    return boxes_of(labelled)


class _Labelling(Part):
    kind: Literal["labelling"]
    sensors: dict[str, list[Annotated[list[_Metres], Field(min_length=3, max_length=3)]]]


def _labelled_places(file: Path) -> dict[str, NDArray[np.float64]]:
    """Return the sensor positions of frames that a model labelled, by frame name."""
    if not file.is_file():
        return {}
    expected = "a folder of urbantwin model label"
    told = validated(read_json(file, kind="labelling"), _Labelling, file=file, expected=expected)
    return {name: np.array(one) for name, one in told.sensors.items() if one}


def _poses(told: FramePoses) -> dict[str, Pose]:
    """Return dataset_SE3_site by frame name; an empty name for a static rig."""
    rows = {frame.name: frame.dataset_SE3_site for frame in told.frames} | {
        "": told.dataset_SE3_site
    }
    return {name: pose_of_matrix(one) for name, one in rows.items() if one is not None}


def boxes_of_objects(objects: LabelledObjects) -> Boxes:
    """Return labelled actors of ours as the boxes of a frame, without boxes of zero size."""
    objects = objects.take((objects.box[:, 3:6] > 0).all(axis=1))
    classes = tuple(objects.class_name.tolist())
    return Boxes(
        box=objects.box,
        class_names=tuple(one if one in ACTOR_CLASSES else "other" for one in classes),
        track=objects.track,
        source_names=classes,
        velocity=objects.velocity,
        num_points=None if (objects.num_points < 0).any() else objects.num_points,
        occlusion=objects.occlusion,
        ignored=tuple(objects.ignored.tolist()),
    )


def sensor_places(
    turns: SensorTurns, frame: str, dataset_SE3_site: Pose
) -> NDArray[np.float64] | None:
    """Return the true sensor positions (S, 3) in the frame of the points; None if unknown."""
    poses = turns.first_poses(frame, "true").values()
    if not poses:
        return None
    return dataset_SE3_site.apply(np.array([one.translation for one in poses]))


_SITE = Pose.from_ypr(np.zeros(3))


def is_fleet(path: Path) -> bool:
    """Return whether a folder is a fleet."""
    manifest = path / "fleet.json"
    return manifest.is_file() and b'"kind": "fleet"' in read_bytes(manifest, "a fleet's manifest")


def open_fleet(path: Path) -> Recording:
    """Open a fleet of ``urbantwin record --nodes`` as one recording in the site frame.

    Sensors are numbered consecutively over the nodes present in a frame.

    Raises:
        InputError: its manifest or a table is damaged.
    """
    files = Fleet(path)

    def read(index: int) -> Frame:
        name = files.names[index]
        clouds: list[NDArray[Any]] = []
        labels: list[NDArray[Any]] = []
        rays: list[dict[str, NDArray[Any]]] = []
        seen_from: list[NDArray[np.float64]] = []
        for node in files.node_names:
            state = files.state(name, node)
            if state.true is None:
                continue
            cloud = files.cloud(name, node)
            clouds.append(
                np.column_stack([state.true.apply(cloud.points[:, :3]), cloud.points[:, 3]])
            )
            labels.append(cloud.labels)
            before = sum(map(len, seen_from))
            own = fields_of_rays(cloud.rays)
            own["sensor"] = own["sensor"].astype(np.int64) + before
            rays.append(own)
            there = sensor_places(files.nodes[node].turns, name, _SITE)
            seen_from.append(state.true.translation[None] if there is None else there)
        points = np.concatenate([np.zeros((0, 4)), *clouds])
        code = np.concatenate([np.zeros(0, np.uint32), *labels])
        given = {"semantic": code & 0xFFFF, "instance": code >> 16}
        given |= (
            {key: np.concatenate([one[key] for one in rays]) for key in rays[0]} if rays else {}
        )
        return frame_of(
            path / "fleet.json",
            dict(zip(POINT, points.T, strict=True)),
            name=name,
            given=given,
            boxes=boxes_of_objects(files.objects.of_frame(name)),
            world_SE3_frame=_SITE,
            sensor_places=np.concatenate(seen_from) if seen_from else np.zeros((1, 3)),
        )

    return Recording(path, "fleet", files.names, read)
