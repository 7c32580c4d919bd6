"""The rows of nuScenes' tables, frame by frame; see ``nuscenes``."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from urbantwin.dataset.reading import Frame
from urbantwin.exports.frames.box_poses import site_boxes
from urbantwin.exports.frames.nuscenes_names import (
    ATTRIBUTES,
    CATEGORIES,
    VISIBILITIES,
    attribute_of,
    visibility_of,
)
from urbantwin.exports.frames.scenes import Scene
from urbantwin.exports.frames.source import FrameSource
from urbantwin.geometry import Pose
from urbantwin.lidar.rig import dataset_frame
from urbantwin.taxonomy import classes_in

__all__ = ["CHANNEL", "STREAMED", "TablesOfFrames", "open_table"]

CHANNEL = "LIDAR_TOP"
#: Tables with rows per frame or box, written as frames are processed.
STREAMED = ("sample", "sample_data", "ego_pose", "sample_annotation", "lidarseg", "panoptic")
#: Rotation from a frame with x right and y forward to one with x forward and y left.
_FRAME_SE3_LIDAR = Pose(np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]), np.zeros(3))

Row = dict[str, Any]
AddRow = Callable[[Row], None]


class TablesOfFrames:
    """Rows of the nuScenes tables.

    Args:
        source: the dataset.
        salt: text that makes the tokens unique to the dataset.
        scenes: the scenes by name, in order of time.

    Attributes:
        rows: function that adds a row, for each of ``STREAMED``.
    """

    def __init__(self, source: FrameSource, salt: str, scenes: dict[str, Scene]) -> None:
        self.rows: dict[str, AddRow] = {}
        self._scenes = scenes
        self._source = source
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
            boxes = source.objects.of_frame(frame_name)
            for track, kind in zip(boxes.track.tolist(), boxes.class_name.tolist(), strict=True):
                if kind in self._category:
                    key = self._scene_of[number], track
                    self._seen.setdefault(key, []).append(number)
                    self._class.setdefault(key, kind)
        #: Number of written frames of each instance.
        self._written: Counter[tuple[str, int]] = Counter()

    @property
    def map_file(self) -> str:
        """Path of the map's mask."""
        return f"maps/{self._token('map')}.png"

    def scene_of(self, number: int) -> str:
        """Return the name of a frame's scene."""
        return self._scene_of[number]

    def sweep(self, frame: Frame) -> str:
        """Return the token of a frame's cloud."""
        return self._token("sample_data", frame.name)

    def add(self, frame: Frame, files: dict[str, str]) -> None:
        """Write the rows of a frame.

        Args:
            frame: the frame.
            files: paths of its cloud and point labels, by ``sample_data``, ``lidarseg`` and
                ``panoptic``.
        """
        number, name = frame.number, frame.name
        scene = self._scenes[self._scene_of[number]].numbers
        before = self._source.names[number - 1] if number > scene[0] else None
        after = self._source.names[number + 1] if number < scene[-1] else None
        site_SE3_ego = self._ego(frame)
        ego_SE3_site = site_SE3_ego.inverse()
        time_us = self._times_us[number]
        lidar = ego_SE3_site @ frame.site_SE3_dataset @ _FRAME_SE3_LIDAR
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
                "filename": files["sample_data"],
                "prev": self._token("sample_data", before),
                "next": self._token("sample_data", after),
            }
        )
        self._annotations(frame)
        token = self.sweep(frame)
        for task in ("lidarseg", "panoptic"):
            self.rows[task]({"token": token, "sample_data_token": token, "filename": files[task]})

    def _annotations(self, frame: Frame) -> None:
        boxes = frame.objects
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
        """Return the tables that do not grow per frame, after the last frame."""
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
                for name, scene in self._scenes.items()
            ],
        }

    def _channels(self) -> list[str]:
        """Channels of the rig's sensors, which have poses but no clouds of their own."""
        return [f"LIDAR_{one['name']}" for one in self._source.sensors]

    def _ego(self, frame: Frame) -> Pose:
        """Return the pose of the rig: upright, at the points' frame, or at the first sensor."""
        if self._source.manifest["frame"] == "site":
            return dataset_frame("level", frame.site_SE3_sensors[self._source.sensors[0]["name"]])
        return dataset_frame("level", frame.site_SE3_dataset)

    def _add_sensors(self, frame: Frame, ego_SE3_site: Pose) -> None:
        for one, channel in zip(self._source.sensors, self._channels(), strict=True):
            pose = ego_SE3_site @ frame.site_SE3_sensors[one["name"]] @ _FRAME_SE3_LIDAR
            self._calibration(channel, pose)

    def _calibration(self, channel: str, ego_SE3_lidar: Pose) -> str:
        """Return the token of a sensor's pose on the rig; poses equal to 1 nm share one."""
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
        """Return the token of a track in a scene; its last 8 digits are the track's number."""
        return f"{self._token('instance', *map(str, key))[:24]}{key[1] & 0xFFFFFFFF:08x}"

    def _annotation(self, key: tuple[str, int], number: int | None) -> str:
        return self._token(
            "sample_annotation", *map(str, key), None if number is None else str(number)
        )

    def _token(self, *of: str | None) -> str:
        """Return a token of 32 digits derived from the arguments; empty if one of them is None."""
        if None in of:
            return ""
        text = "\0".join([self._salt, *(str(one) for one in of)])
        return hashlib.sha256(text.encode()).hexdigest()[:32]


def _placed(pose: Pose, places: int = 16) -> Row:
    return {
        "translation": [round(value, places) + 0.0 for value in pose.translation.tolist()],
        "rotation": [round(value, places) + 0.0 for value in pose.quaternion()],
    }


@contextmanager
def open_table(path: Path) -> Iterator[AddRow]:
    """Yield a function that adds a row to a table: a JSON list with one row per line."""
    with path.open("w", encoding="utf-8", newline="\n") as file:
        separators = iter(["[\n"])

        def add(row: Row) -> None:
            file.write(next(separators, ",\n"))
            file.write(json.dumps(row, allow_nan=False))

        yield add
        file.write(f"{next(separators, '')}\n]\n")
