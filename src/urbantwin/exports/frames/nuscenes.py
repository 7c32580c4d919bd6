"""nuScenes: its tables, and the clouds of ``LIDAR_TOP``; every frame is a key frame.

The thirteen tables, and those of classes and objects of points: ``lidarseg`` and ``panoptic``.

Source: Caesar et al. 2020, and the schema and code of nuscenes-devkit 1.2.0. Points are in the
frame of the LiDAR with x to the right and y forward; boxes and ego poses are in the site, which is
the global frame. Sizes are width, length, height, rotations w, x, y, z, times microseconds.
"""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from urbantwin.artefact import sha256_of, write_json
from urbantwin.exports.frames.box_poses import site_boxes
from urbantwin.exports.frames.nuscenes_names import (
    ATTRIBUTES,
    CATEGORIES,
    VISIBILITIES,
    attribute_of,
    scene_names,
    visibility_of,
)
from urbantwin.exports.frames.nuscenes_points import LabelledPoints
from urbantwin.exports.frames.scenes import Scene, scenes_of
from urbantwin.exports.frames.source import FrameSource, SourceFrame
from urbantwin.geometry import Pose
from urbantwin.lidar.rig import dataset_frame
from urbantwin.progress import Progress, each
from urbantwin.taxonomy import classes_in

__all__ = ["losses_nuscenes", "write_nuscenes"]

#: The folder of the tables: what tools for training ask for.
VERSION = "v1.0-trainval"
CHANNEL = "LIDAR_TOP"
#: nuScenes has intensity as 0..255, in whole numbers there.
INTENSITY = 255
#: Parts of the split as ``splits.json`` calls them: the devkit's own names mean its own scenes.
CUSTOM_SPLIT = "urbantwin_{}"
#: What takes points with x to the right and y forward to those with x forward and y left.
_FRAME_SE3_LIDAR = Pose(np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]), np.zeros(3))
_MASK_PIXELS = 1000
#: What labels points, and the ending of its files.
_OF_POINTS = {"lidarseg": "bin", "panoptic": "npz"}
#: Tables with a row for each frame or box, written as they come.
_STREAMED = ("sample", "sample_data", "ego_pose", "sample_annotation", *_OF_POINTS)

Row = dict[str, Any]
_Add = Callable[[Row], None]


def losses_nuscenes(source: FrameSource) -> list[str]:
    """Return what becomes coarser."""
    told = ["of boxes: occlusion becomes one of nuScenes' four levels of visibility"]
    if len(scenes_of(source)) > 1:
        told.append("of boxes: a track is followed within a scene, as in nuScenes, not across two")
    return told if source.class_names else []


def write_nuscenes(source: FrameSource, folder: Path, tell: Progress) -> list[str]:
    """Write a dataset as nuScenes: ``v1.0-trainval/``, ``samples/LIDAR_TOP/`` and ``maps/``.

    Args:
        source: the dataset.
        folder: to write into.
        tell: told how far it is.

    Returns:
        What a person should be told.
    """
    tables = folder / VERSION
    (folder / "samples" / CHANNEL).mkdir(parents=True)
    (folder / "maps").mkdir()
    tables.mkdir()
    for task in _OF_POINTS:
        (folder / task / VERSION).mkdir(parents=True)
    name = sha256_of(source.folder / "dataset.json")
    scenes = scenes_of(source)
    called = scene_names([scene.part for scene in scenes])
    writer = _Writer(source, folder, name, dict(zip(called, scenes, strict=True)))
    with ExitStack() as open_tables:
        for table in _STREAMED:
            writer.rows[table] = open_tables.enter_context(_table(tables / f"{table}.json"))
        for number in each(range(len(source)), tell, "frames"):
            writer.frame(source[number])
    for table, rows in writer.small_tables().items():
        write_json(tables / f"{table}.json", rows)
    splits: dict[str, list[str]] = {CUSTOM_SPLIT.format(part): [] for part in source.split}
    for scene_name, scene in writer.scenes.items():
        if scene.part is not None:
            splits[CUSTOM_SPLIT.format(scene.part)].append(scene_name)
    write_json(tables / "splits.json", splits)
    Image.new("L", (_MASK_PIXELS, _MASK_PIXELS)).save(folder / writer.map_file)
    parts = ", ".join(f"{key} {len(names)}" for key, names in splits.items()) or "none"
    beyond = writer.points.unnumbered
    return [
        *(
            [f"of points: {beyond} objects beyond 999 of a category in a scene have no number"]
            if beyond
            else []
        ),
        f"every frame is a key frame ({source.rate_hz:g} a second): there are no sweeps between",
        f"scenes of each split ({VERSION}/splits.json): {parts}",
    ]


class _Writer:
    """The rows of the tables, frame by frame."""

    def __init__(
        self, source: FrameSource, folder: Path, salt: str, scenes: dict[str, Scene]
    ) -> None:
        self.scenes = scenes
        self.rows: dict[str, _Add] = {}
        self.points = LabelledPoints()
        self._source = source
        self._folder = folder
        self._salt = salt
        self._times_us = np.round(source.times_s * 1e6).astype(np.int64).tolist()
        self._scene_of = {n: name for name, scene in scenes.items() for n in scene.numbers}
        self._category = {
            ours: theirs for ours, theirs in classes_in("nuscenes").items() if theirs is not None
        }
        #: Frames of each instance by scene and track, and its class.
        self._seen: dict[tuple[str, int], list[int]] = {}
        self._class: dict[tuple[str, int], str] = {}
        self._calibrated: dict[str, Row] = {}
        for number, frame_name in enumerate(source.names):
            boxes = source.boxes_of(frame_name)
            for track, kind in zip(boxes.track.tolist(), boxes.class_name.tolist(), strict=True):
                if kind in self._category:
                    key = self._scene_of[number], track
                    self._seen.setdefault(key, []).append(number)
                    self._class.setdefault(key, kind)
        #: How many frames of each instance are written.
        self._written: Counter[tuple[str, int]] = Counter()

    @property
    def map_file(self) -> str:
        """Where the mask of the map is."""
        return f"maps/{self._token('map')}.png"

    def frame(self, frame: SourceFrame) -> None:
        """Write the cloud of a frame, and its rows."""
        number, name = frame.number, frame.name
        scene = self.scenes[self._scene_of[number]].numbers
        before = self._source.names[number - 1] if number > scene[0] else None
        after = self._source.names[number + 1] if number < scene[-1] else None
        file = f"samples/{CHANNEL}/{name}.pcd.bin"
        _write_cloud(self._folder / file, frame)
        site_SE3_ego = self._ego(frame)
        ego_SE3_site = site_SE3_ego.inverse()
        time_us = self._times_us[number]
        lidar = ego_SE3_site @ frame.site_SE3_frame @ _FRAME_SE3_LIDAR
        if not self._calibrated:
            self._add_sensors(frame, ego_SE3_site)
        self.rows["ego_pose"](
            {"token": self._token("ego_pose", name), "timestamp": time_us, **_placed(site_SE3_ego)}
        )
        self.rows["sample"](
            {
                "token": self._token("sample", name),
                "timestamp": time_us,
                "prev": self._token("sample", before),
                "next": self._token("sample", after),
                "scene_token": self._token("scene", self._scene_of[number]),
            }
        )
        self.rows["sample_data"](
            {
                "token": self._token("sample_data", name),
                "sample_token": self._token("sample", name),
                "ego_pose_token": self._token("ego_pose", name),
                "calibrated_sensor_token": self._calibration(CHANNEL, lidar),
                "timestamp": time_us,
                "fileformat": "pcd",
                "is_key_frame": True,
                "height": 0,
                "width": 0,
                "filename": file,
                "prev": self._token("sample_data", before),
                "next": self._token("sample_data", after),
            }
        )
        self._annotations(frame)
        token = self._token("sample_data", name)
        files = {
            task: f"{task}/{VERSION}/{token}_{task}.{ending}" for task, ending in _OF_POINTS.items()
        }
        for task, filename in files.items():
            self.rows[task]({"token": token, "sample_data_token": token, "filename": filename})
        lidarseg, panoptic = (self._folder / filename for filename in files.values())
        self.points.write(frame, self._scene_of[number], lidarseg, panoptic)

    def _annotations(self, frame: SourceFrame) -> None:
        boxes = frame.boxes
        middles, rotations = site_boxes(frame)
        scene = self._scene_of[frame.number]
        for row, (track, kind) in enumerate(
            zip(boxes.track.tolist(), boxes.class_name.tolist(), strict=True)
        ):
            if kind not in self._category:
                continue
            key = scene, track
            numbers, at = self._seen[key], self._written[key]
            self._written[key] += 1
            before = numbers[at - 1] if at else None
            after = numbers[at + 1] if at + 1 < len(numbers) else None
            length, width, height = boxes.box[row, 3:6].tolist()
            speed = float(np.linalg.norm(boxes.velocity[row]))
            attribute = attribute_of(self._category[kind], speed, bool(boxes.parked[row]))
            self.rows["sample_annotation"](
                {
                    "token": self._annotation(key, frame.number),
                    "sample_token": self._token("sample", frame.name),
                    "instance_token": self._instance(key),
                    "visibility_token": visibility_of(float(boxes.occlusion[row])),
                    "attribute_tokens": []
                    if attribute is None
                    else [self._token("attribute", attribute)],
                    **_placed(Pose(rotations[row], middles[row])),
                    "size": [width, length, height],
                    "prev": self._annotation(key, before),
                    "next": self._annotation(key, after),
                    "num_lidar_pts": int(boxes.num_points[row]),
                    "num_radar_pts": 0,
                }
            )

    def small_tables(self) -> dict[str, list[Row]]:
        """Return the tables that are as large as the dataset is varied, after the last frame."""
        log = self._token("log")
        return {
            "category": [
                {
                    "token": self._token("category", one),
                    "name": one,
                    "description": "",
                    "index": index,
                }
                for index, one in enumerate(CATEGORIES)
            ],
            "attribute": [
                {"token": self._token("attribute", one), "name": one, "description": ""}
                for one in ATTRIBUTES
            ],
            "visibility": [
                {"token": token, "level": level, "description": ""}
                for token, level in VISIBILITIES.items()
            ],
            "instance": [
                {
                    "token": self._instance(key),
                    "category_token": self._token("category", self._category[self._class[key]]),
                    "nbr_annotations": len(numbers),
                    "first_annotation_token": self._annotation(key, numbers[0]),
                    "last_annotation_token": self._annotation(key, numbers[-1]),
                }
                for key, numbers in self._seen.items()
            ],
            "sensor": [
                {"token": self._token("sensor", one), "channel": one, "modality": "lidar"}
                for one in (CHANNEL, *self._channels())
            ],
            "calibrated_sensor": list(self._calibrated.values()),
            "log": [
                {
                    "token": log,
                    "logfile": "urbantwin",
                    "vehicle": "rig",
                    "date_captured": "",
                    "location": "site",
                }
            ],
            "map": [
                {
                    "token": self._token("map"),
                    "log_tokens": [log],
                    "category": "semantic_prior",
                    "filename": self.map_file,
                }
            ],
            "scene": [
                {
                    "token": self._token("scene", name),
                    "log_token": log,
                    "nbr_samples": len(scene.numbers),
                    "first_sample_token": self._sample(scene.numbers[0]),
                    "last_sample_token": self._sample(scene.numbers[-1]),
                    "name": name,
                    "description": scene.part or "of no part of the split",
                }
                for name, scene in self.scenes.items()
            ],
        }

    def _channels(self) -> list[str]:
        """Channels of the rig's own sensors: they have a place, and no clouds of their own."""
        return [f"LIDAR_{one['name']}" for one in self._source.sensors]

    def _ego(self, frame: SourceFrame) -> Pose:
        """Return the pose of the rig: upright, where the points' frame is, or the first sensor."""
        if self._source.manifest["frame"] == "site":
            return dataset_frame("level", frame.site_SE3_sensors[self._source.sensors[0]["name"]])
        return dataset_frame("level", frame.site_SE3_frame)

    def _add_sensors(self, frame: SourceFrame, ego_SE3_site: Pose) -> None:
        for one, channel in zip(self._source.sensors, self._channels(), strict=True):
            pose = ego_SE3_site @ frame.site_SE3_sensors[one["name"]] @ _FRAME_SE3_LIDAR
            self._calibration(channel, pose)

    def _calibration(self, channel: str, ego_SE3_lidar: Pose) -> str:
        """Return the token of a sensor's place on the rig, the same for the same to 1 nm."""
        placed = _placed(ego_SE3_lidar, 9)
        token = self._token("calibrated_sensor", channel, json.dumps(placed))
        self._calibrated.setdefault(
            token,
            {
                "token": token,
                "sensor_token": self._token("sensor", channel),
                **placed,
                "camera_intrinsic": [],
            },
        )
        return token

    def _sample(self, number: int) -> str:
        return self._token("sample", self._source.names[number])

    def _instance(self, key: tuple[str, int]) -> str:
        """Return the token of a track in a scene: its last 8 digits are the track's number."""
        return f"{self._token('instance', *map(str, key))[:24]}{key[1] & 0xFFFFFFFF:08x}"

    def _annotation(self, key: tuple[str, int], number: int | None) -> str:
        return self._token(
            "sample_annotation", *map(str, key), None if number is None else str(number)
        )

    def _token(self, *of: str | None) -> str:
        """Return 32 digits, the same for the same; nothing for what is not there."""
        if None in of:
            return ""
        text = "\0".join([self._salt, *(str(one) for one in of)])
        return hashlib.sha256(text.encode()).hexdigest()[:32]


def _write_cloud(path: Path, frame: SourceFrame) -> None:
    """Write x, y, z, intensity, ring as float32."""
    rows = np.zeros((len(frame.points), 5), "<f4")
    rows[:, 0], rows[:, 1], rows[:, 2] = -frame.points[:, 1], frame.points[:, 0], frame.points[:, 2]
    rows[:, 3] = frame.intensity * np.float32(INTENSITY)
    rows[:, 4] = _ring(frame)
    rows.tofile(path)


def _ring(frame: SourceFrame) -> NDArray[Any]:
    if "ring" in (frame.rays.dtype.names or ()):
        return np.asarray(frame.rays["ring"])
    return np.zeros(len(frame.points))


def _placed(pose: Pose, places: int = 16) -> Row:
    return {
        "translation": [round(value, places) + 0.0 for value in pose.translation.tolist()],
        "rotation": [round(value, places) + 0.0 for value in pose.quaternion()],
    }


@contextmanager
def _table(path: Path) -> Iterator[_Add]:
    """Yield what adds a row to a table: a list in JSON, a row on a line."""
    with path.open("w", encoding="utf-8", newline="\n") as file:
        separators = iter(["[\n"])

        def add(row: Row) -> None:
            file.write(next(separators, ",\n"))
            file.write(json.dumps(row, allow_nan=False))

        yield add
        file.write(f"{next(separators, '')}\n]\n")
