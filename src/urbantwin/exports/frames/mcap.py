"""MCAP: ROS 2 messages for Foxglove and ``ros2 bag play``, and all labels as JSON.

Source: the MCAP specification 0; ``sensor_msgs``, ``tf2_msgs`` and ``visualization_msgs`` of ROS 2
Humble. Topics: ``/points`` (PointCloud2 with every field of the points), ``/tf`` (site to the frame
of the points, and to the sensors), ``/markers`` (boxes for display) and ``/labels`` (JSON: all box
columns of a dataset, and the frame's values). Times are those of the motion, from 0.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from urbantwin import __version__
from urbantwin.artefact import sha256_of
from urbantwin.dataset.reading import Frame
from urbantwin.dataset.reading.manifest import pose_matrix
from urbantwin.exports.frames.box_rows import BOX_KEYS, box_rows
from urbantwin.exports.frames.pcd import point_record
from urbantwin.exports.frames.source import FrameSource
from urbantwin.extras import check_extra
from urbantwin.fidelity.readers.tables import LABELS
from urbantwin.geometry import Pose
from urbantwin.progress import Progress
from urbantwin.taxonomy import BOX_SEMANTICS, semantic_classes

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

__all__ = ["LABELS_TOPIC", "POINTS_TOPIC", "write_mcap"]

POINTS_TOPIC, LABELS_TOPIC = "/points", "/labels"
_TOPICS = {
    POINTS_TOPIC: "sensor_msgs/msg/PointCloud2",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/markers": "visualization_msgs/msg/MarkerArray",
}
#: Frames of reference: the site's, and that of the points.
_SITE, _POINTS = "site", "points"
#: PointField's numbers of types.
_FIELD_TYPES = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}
_CUBE, _ADD = 1, 0
_NUMBER: dict[str, Any] = {"type": "number"}
_TEXTS = ("class", "difficulty", "ignored")
_LABELS_SCHEMA = {
    "title": LABELS,
    "type": "object",
    "properties": {
        "name": {"type": "string"},
        "time_s": _NUMBER,
        "part": {"type": ["string", "null"]},
        "site_SE3_frame": {"type": "array"},
        "site_SE3_sensors": {"type": "object"},
        "boxes": {
            "type": "array",
            "items": {
                "type": "object",
                "properties": {
                    name: {"type": ["string", "null"]} if name in _TEXTS else {}
                    for name in BOX_KEYS
                },
            },
        },
    },
}


def write_mcap(source: FrameSource, file: Path, tell: Progress) -> list[str]:
    """Write all frames to one file, chunk by chunk, compressed by zstd."""
    check_extra("bags", "writing MCAP", place="--to mcap")
    from mcap.writer import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    with file.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2", library=f"urbantwin {__version__}")
        channels = {
            topic: writer.register_channel(
                topic,
                "cdr",
                writer.register_schema(
                    kind, "ros2msg", store.generate_msgdef(kind, ros_version=2)[0].encode()
                ),
            )
            for topic, kind in _TOPICS.items()
        }
        schema = json.dumps(_LABELS_SCHEMA).encode()
        channels[LABELS_TOPIC] = writer.register_channel(
            LABELS_TOPIC, "json", writer.register_schema(LABELS, "jsonschema", schema)
        )
        # The file is passed on without an `exported.json`, so it contains its origin.
        told = {
            "dataset_sha256": sha256_of(source.folder / "dataset.json"),
            "inputs": json.dumps(source.manifest["inputs"], ensure_ascii=False, sort_keys=True),
        }
        writer.add_metadata("urbantwin", told)
        for frame in source:
            tell(frame.number / len(source), f"frame {frame.name}")
            stamp_ns = round(frame.time_s * 1e9)
            for topic, content in _messages(store, source, frame):
                writer.add_message(channels[topic], stamp_ns, content, stamp_ns, frame.number)
        writer.finish()  # type: ignore[no-untyped-call]
    return []


def _messages(store: Typestore, source: FrameSource, frame: Frame) -> Iterator[tuple[str, bytes]]:
    made = _Made(store, round(frame.time_s * 1e9))
    for topic, message in (
        ("/tf", made.transforms(frame)),
        (POINTS_TOPIC, made.points(frame)),
        ("/markers", made.markers(frame, 1 / source.rate_hz)),
    ):
        yield topic, bytes(store.serialize_cdr(message, _TOPICS[topic]))
    told = {
        "name": frame.name,
        "time_s": frame.time_s,
        "part": source.part_of(frame.name),
        "site_SE3_frame": pose_matrix(frame.site_SE3_dataset),
        "site_SE3_sensors": {
            name: pose_matrix(pose) for name, pose in frame.site_SE3_sensors.items()
        },
        "boxes": list(box_rows(frame.objects)),
    }
    yield LABELS_TOPIC, json.dumps(told, separators=(",", ":"), allow_nan=False).encode()


class _Made:
    """Messages of one frame, of the types of a store."""

    def __init__(self, store: Typestore, stamp_ns: int) -> None:
        self._types = store.types
        seconds, nanoseconds = divmod(stamp_ns, 10**9)
        self._stamp = self._of("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)

    def points(self, frame: Frame) -> Any:  # noqa: ANN401 - a type of the store's
        record = point_record(frame)
        kinds = record.dtype
        fields = [
            self._of(
                "sensor_msgs/msg/PointField",
                name=name,
                offset=kinds.fields[name][1],  # type: ignore[index]
                datatype=_FIELD_TYPES[kinds[name].str[1:]],
                count=1,
            )
            for name in kinds.names or ()
        ]
        return self._of(
            "sensor_msgs/msg/PointCloud2",
            header=self._header(_POINTS),
            height=1,
            width=len(record),
            fields=fields,
            is_bigendian=False,
            point_step=kinds.itemsize,
            row_step=kinds.itemsize * len(record),
            data=record.view(np.uint8).reshape(-1),
            is_dense=True,
        )

    def transforms(self, frame: Frame) -> Any:  # noqa: ANN401
        poses = {_POINTS: frame.site_SE3_dataset, **frame.site_SE3_sensors}
        return self._of(
            "tf2_msgs/msg/TFMessage",
            transforms=[
                self._of(
                    "geometry_msgs/msg/TransformStamped",
                    header=self._header(_SITE),
                    child_frame_id=name if name == _POINTS else f"sensor/{name}",
                    transform=self._of(
                        "geometry_msgs/msg/Transform",
                        translation=self._vector(*pose.translation.tolist()),
                        rotation=self._turn(pose),
                    ),
                )
                for name, pose in poses.items()
            ],
        )

    def markers(self, frame: Frame, lifetime_s: float) -> Any:  # noqa: ANN401
        colours = semantic_classes()
        lifetime = self._of(
            "builtin_interfaces/msg/Duration",
            sec=int(lifetime_s),
            nanosec=round(lifetime_s % 1 * 1e9),
        )
        markers = []
        for track, name, box, ignored in zip(
            frame.objects.track, frame.objects.class_name, frame.objects.box, frame.objects.ignored,
            strict=True,
        ):  # fmt: skip
            red, green, blue = (part / 255 for part in colours[BOX_SEMANTICS[str(name)]].colour)
            x, y, z, length, width, height, yaw = box.tolist()
            markers.append(
                self._of(
                    "visualization_msgs/msg/Marker",
                    header=self._header(_POINTS),
                    ns=str(name),
                    id=int(track),
                    type=_CUBE,
                    action=_ADD,
                    pose=self._of(
                        "geometry_msgs/msg/Pose",
                        position=self._of("geometry_msgs/msg/Point", x=x, y=y, z=z),
                        orientation=self._turn(Pose.from_ypr([0, 0, 0], yaw)),
                    ),
                    scale=self._vector(length, width, height),
                    # Boxes that do not count are nearly transparent.
                    color=self._of(
                        "std_msgs/msg/ColorRGBA",
                        r=red,
                        g=green,
                        b=blue,
                        a=0.1 if ignored else 0.4,
                    ),
                    lifetime=lifetime,
                    frame_locked=False,
                    points=[],
                    colors=[],
                    texture_resource="",
                    texture=self._of(
                        "sensor_msgs/msg/CompressedImage",
                        header=self._header(_POINTS),
                        format="",
                        data=np.zeros(0, np.uint8),
                    ),
                    uv_coordinates=[],
                    text="",
                    mesh_resource="",
                    mesh_file=self._of(
                        "visualization_msgs/msg/MeshFile",
                        filename="",
                        data=np.zeros(0, np.uint8),
                    ),
                    mesh_use_embedded_materials=False,
                )
            )
        return self._of("visualization_msgs/msg/MarkerArray", markers=markers)

    def _of(self, kind: str, **values: Any) -> Any:  # noqa: ANN401
        return self._types[kind](**values)

    def _header(self, frame_id: str) -> Any:  # noqa: ANN401
        return self._of("std_msgs/msg/Header", stamp=self._stamp, frame_id=frame_id)

    def _vector(self, x: float, y: float, z: float) -> Any:  # noqa: ANN401
        return self._of("geometry_msgs/msg/Vector3", x=x, y=y, z=z)

    def _turn(self, pose: Pose) -> Any:  # noqa: ANN401
        w, x, y, z = pose.quaternion()
        return self._of("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)
