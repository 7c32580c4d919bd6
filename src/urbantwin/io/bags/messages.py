"""Messages of ROS, Foxglove and Livox with clouds or transforms.

Sources: ROS, ``sensor_msgs/PointCloud2.msg`` and ``PointField.msg``; Foxglove, "PointCloud schema"
(docs.foxglove.dev/docs/visualization/message-schemas/point-cloud) in protobuf and in JSON; Livox,
livox_ros_driver, README.md ("Livox custom msg format").
"""

from __future__ import annotations

import base64
import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.geometry import Pose
from urbantwin.geometry.pose import ypr_from_rotation
from urbantwin.io.bags.files import Topic
from urbantwin.io.points import organised
from urbantwin.io.poses import pose_of_quaternion
from urbantwin.io.trust import reading
from urbantwin.strict_json import parse_json

__all__ = [
    "CLOUDS",
    "OUSTER_PACKAGES",
    "TRANSFORMS",
    "cloud_message",
    "is_static",
    "place_of_frame",
    "ros_message",
    "static_transforms",
]

OUSTER_PACKAGES = ("ouster_ros", "ouster_sensor_msgs", "ouster_msgs")

LIVOX_PACKAGES = ("livox_ros_driver", "livox_ros_driver2", "livox_interfaces")

#: Cloud definition of all Livox drivers.
_LIVOX_CLOUD = (
    "std_msgs/Header header\nuint64 timebase\nuint32 point_num\nuint8 lidar_id\nuint8[3] rsvd\n"
    "CustomPoint[] points\n",
    "{}/CustomPoint",
    "uint32 offset_time\nfloat32 x\nfloat32 y\nfloat32 z\n"
    "uint8 reflectivity\nuint8 tag\nuint8 line\n",
)
#: Message definitions of LiDAR drivers, as files of ROS 2 before Iron contain none.
_DRIVERS = {
    "velodyne_msgs/msg/VelodyneScan": (
        "std_msgs/Header header\nVelodynePacket[] packets\n",
        "velodyne_msgs/VelodynePacket",
        "time stamp\nuint8[1206] data\n",
    ),
    "pandar_msgs/msg/PandarScan": (
        "std_msgs/Header header\nPandarPacket[] packets\n",
        "pandar_msgs/PandarPacket",
        "time stamp\nuint8[1500] data\nuint32 size\n",
    ),
    "nebula_msgs/msg/NebulaPackets": (
        "std_msgs/Header header\nNebulaPacket[] packets\n",
        "nebula_msgs/NebulaPacket",
        "time stamp\nuint8[] data\n",
    ),
    "hesai_ros_driver/msg/UdpFrame": (
        "std_msgs/Header header\nUdpPacket[] packets\n",
        "hesai_ros_driver/UdpPacket",
        "uint8[] data\nuint32 size\n",
    ),
    **{f"{package}/msg/PacketMsg": ("uint8[] buf\n", "", "") for package in OUSTER_PACKAGES},
    **{
        f"{package}/msg/CustomMsg": (
            _LIVOX_CLOUD[0],
            _LIVOX_CLOUD[1].format(package),
            _LIVOX_CLOUD[2],
        )
        for package in LIVOX_PACKAGES
    },
}
#: Maximum size of a definition to parse, bytes.
_MOST_BYTES = 1_000_000


def ros_message(topic: Topic, data: bytes) -> Any:  # noqa: ANN401 - its fields are those of its type
    """Return a message of ROS 1 or ROS 2.

    Raises:
        Exception: of the library, if the bytes are no such message, or it has no definition.
    """
    known = _types(topic.kind, topic.encoding, topic.schema)
    if topic.encoding == "ros1":
        return known.deserialize_ros1(data, topic.kind)
    return known.deserialize_cdr(data, topic.kind)


@lru_cache(16)
def _types(kind: str, encoding: str, schema: bytes) -> Any:  # noqa: ANN401 - of a library
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    known = get_typestore(Stores.ROS1_NOETIC if encoding == "ros1" else Stores.ROS2_FOXY)
    if kind in known.fielddefs:
        return known
    text = schema.decode() if len(schema) < _MOST_BYTES else ""
    if kind in _DRIVERS and not text:
        whole, part, fields = _DRIVERS[kind]
        text = f"{whole}{'=' * 80}\nMSG: {part}\n{fields}" if part else whole
    is_idl = text.lstrip().startswith(("=====", "module", "#include", "//"))
    defined = get_types_from_idl(text) if is_idl else get_types_from_msg(text, kind)
    known.register({name: one for name, one in defined.items() if name not in known.fielddefs})
    return known


_POINT_CLOUD2 = "sensor_msgs/msg/PointCloud2"
_FOXGLOVE = ("foxglove.PointCloud", "foxglove_msgs/msg/PointCloud", "foxglove/PointCloud")
#: Types of messages that are clouds.
_LIVOX = tuple(f"{package}/msg/CustomMsg" for package in LIVOX_PACKAGES)
CLOUDS = (_POINT_CLOUD2, *_FOXGLOVE, *_LIVOX)
_ENCODINGS = ("ros1", "cdr", "protobuf", "json")
#: Type codes of PointField, and those of Foxglove's PackedElementField.
_OF_ROS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
_OF_FOXGLOVE = {1: "u1", 2: "i1", 3: "u2", 4: "i2", 5: "u4", 6: "i4", 7: "f4", 8: "f8"}
_EXPECTED = "a cloud"


@dataclass(frozen=True, eq=False)
class CloudMessage:
    """The cloud of a message.

    Attributes:
        fields: arrays (N,) by name in lower case.
        frame_id: frame of the points.
        place: position of the sensor in that frame, metres; None if not stated.
    """

    fields: dict[str, NDArray[np.generic]]
    frame_id: str
    place: NDArray[np.float64] | None = None


def cloud_message(topic: Topic, data: bytes, file: Path, place: str) -> CloudMessage:
    """Return the cloud of a message.

    Args:
        topic: topic of the message.
        data: its bytes.
        file: its file, for errors.
        place: its position in the file, for errors.

    Raises:
        InputError: the bytes are not such a message, or a field is outside of a point.
    """
    if topic.encoding not in _ENCODINGS:
        raise InputError(
            f"is encoded as {topic.encoding or 'nothing'}, which is unknown",
            file=file,
            place=place,
            expected=", ".join(_ENCODINGS),
        )
    with reading(file, _EXPECTED, place):
        if topic.kind == _POINT_CLOUD2:
            return _of_ros(ros_message(topic, data))
        if topic.kind in _LIVOX:
            return _of_livox(ros_message(topic, data))
        return _of_foxglove(_foxglove(topic, data), as_json=topic.encoding == "json")


def _of_ros(message: Any) -> CloudMessage:  # noqa: ANN401
    order = ">" if message.is_bigendian else "<"
    layout = [
        (str(one.name), int(one.offset), order + _type(_OF_ROS, one.datatype), int(one.count))
        for one in message.fields
    ]
    height, width = int(message.height), int(message.width)
    fields = _values(
        memoryview(message.data).cast("B"),
        layout,
        (height, width),
        (int(message.row_step), int(message.point_step)),
    )
    return CloudMessage(organised(fields, height, width), str(message.header.frame_id))


def _of_livox(message: Any) -> CloudMessage:  # noqa: ANN401
    fields: dict[str, NDArray[np.generic]] = {
        name: np.array([getattr(point, name) for point in message.points], np.float64)
        for name in ("x", "y", "z", "reflectivity", "line", "offset_time")
    }
    return CloudMessage(fields, str(message.header.frame_id))


def _of_foxglove(message: Any, *, as_json: bool) -> CloudMessage:  # noqa: ANN401
    def part(of: Any, name: str, default: Any = None) -> Any:  # noqa: ANN401
        return of.get(name, default) if as_json else getattr(of, name, default)

    data = part(message, "data", b"")
    data = base64.b64decode(data, validate=True) if isinstance(data, str) else data
    layout = [
        (
            str(part(one, "name")),
            int(part(one, "offset", 0)),
            "<" + _type(_OF_FOXGLOVE, part(one, "type", 0)),
            1,
        )
        for one in part(message, "fields", ())
    ]
    step = int(part(message, "point_stride", 0))
    whole = memoryview(data).cast("B")
    if step <= 0 or len(whole) % step:
        raise ValueError(f"has {len(whole)} bytes of points of {step}")
    count = len(whole) // step
    fields = _values(whole, layout, (1, count), (count * step, step))
    pose = part(message, "pose")
    moved = None if pose is None else _pose(pose, part)
    if moved is None or not {"x", "y", "z"} <= set(fields):
        return CloudMessage(fields, str(part(message, "frame_id", "")))
    points = moved.apply(np.column_stack([fields[axis] for axis in "xyz"]))
    placed = dict(zip("xyz", points.T, strict=True))
    frame = str(part(message, "frame_id", ""))
    return CloudMessage(fields | placed, frame, moved.translation)


def _type(known: dict[int, str], number: Any) -> str:  # noqa: ANN401
    if int(number) not in known:
        raise ValueError(f"has a field of type {number}, which is unknown")
    return known[int(number)]


def _values(
    data: memoryview,
    layout: Iterable[tuple[str, int, str, int]],
    shape: tuple[int, int],
    steps: tuple[int, int],
) -> dict[str, NDArray[np.generic]]:
    """Return the fields of points stored row by row.

    Args:
        data: the bytes.
        layout: name, offset in a point, type and number of values of each field.
        shape: rows, and points in each.
        steps: bytes per row, and per point.
    """
    (height, width), (row, step) = shape, steps
    if height * width and step <= 0:
        raise ValueError("has points of 0 bytes")
    # drivers leave the row step undefined for single rows
    row = row if height > 1 else width * step
    needed = (height - 1) * row + width * step if height * width else 0
    if row < width * step or needed > len(data):
        raise ValueError(
            f"says {height} times {width} points of {step} bytes, in rows of {row}, and has "
            f"{len(data)} bytes"
        )
    fields: dict[str, NDArray[np.generic]] = {}
    for name, offset, kind, count in layout:
        form = np.dtype(kind)
        end = offset + max(count, 1) * form.itemsize
        if offset < 0 or end > step:
            raise ValueError(f"has field {name:.40} at bytes {offset} to {end} of points of {step}")
        # vectors and padding are not attributes of a frame
        if count <= 1 and name and name.lower() not in fields:
            values = np.ndarray((height, width), form, data, offset, (row, step)) if needed else (
                np.zeros((height, width), form)
            )  # fmt: skip
            fields[name.lower()] = values.astype(form.newbyteorder("=")).ravel()
    return fields


def _foxglove(topic: Topic, data: bytes) -> Any:  # noqa: ANN401
    if topic.encoding == "json":
        message = parse_json(data)
        if not isinstance(message, dict):
            raise ValueError("is no object")
        return message
    if topic.encoding == "protobuf":
        return _protobuf(topic.kind, topic.schema)(data)
    return ros_message(topic, data)


@lru_cache(16)
def _protobuf(kind: str, schema: bytes) -> Any:  # noqa: ANN401 - of a library
    from mcap.records import Schema
    from mcap_protobuf.decoder import DecoderFactory

    of_kind = Schema(id=1, data=schema, encoding="protobuf", name=kind)
    return DecoderFactory().decoder_for("protobuf", of_kind)


def _pose(pose: Any, part: Any) -> Pose | None:  # noqa: ANN401
    """Return the pose of the points' own frame; None if it is the identity or missing."""
    position, orientation = part(pose, "position"), part(pose, "orientation")
    if position is None and orientation is None:
        return None
    xyz = [0.0 if position is None else float(part(position, axis, 0.0)) for axis in "xyz"]
    turn = [0.0 if orientation is None else float(part(orientation, axis, 0.0)) for axis in "xyzw"]
    found = pose_of(xyz, turn)
    if not found.translation.any() and np.array_equal(found.rotation, np.eye(3)):
        return None
    return found


def pose_of(xyz: list[float], xyzw: list[float]) -> Pose:
    """Return the pose of a position and a quaternion; no rotation for a zero quaternion.

    Raises:
        ValueError: a number is not finite.
    """
    if not np.isfinite([*xyz, *xyzw]).all():
        raise ValueError("has a pose that is not finite")
    x, y, z, w = xyzw if any(xyzw) else (0.0, 0.0, 0.0, 1.0)
    return pose_of_quaternion(w, x, y, z, xyz)


#: Message type of transforms, and the topic suffix of static ones.
TRANSFORMS = "tf2_msgs/msg/TFMessage"
_STATIC = "tf_static"


def is_static(topic_name: str) -> bool:
    """Return whether a topic has static transforms."""
    return topic_name.rstrip("/").endswith(_STATIC)


def static_transforms(messages: Iterable[Any]) -> dict[str, tuple[str, Pose]]:
    """Return parent and pose of every frame, from the last message about it.

    Raises:
        ValueError: a number is not finite.
    """
    found = {}
    for message in messages:
        for one in message.transforms:
            moved, turned = one.transform.translation, one.transform.rotation
            found[_name(one.child_frame_id)] = (
                _name(one.header.frame_id),
                pose_of([moved.x, moved.y, moved.z], [turned.x, turned.y, turned.z, turned.w]),
            )
    return found


def place_of_frame(frame_id: str, transforms: dict[str, tuple[str, Pose]]) -> str | None:
    """Return a note about a frame's pose in the root frame; None if unknown."""
    frame, pose, seen = _name(frame_id), None, set()
    while frame in transforms and frame not in seen:
        seen.add(frame)
        frame, step = transforms[frame]
        pose = step if pose is None else step @ pose
    if pose is None:
        return None
    yaw, pitch, roll = (math.degrees(angle) + 0.0 for angle in ypr_from_rotation(pose.rotation))
    x, y, z = pose.translation
    return (
        f"Points are in the frame {_name(frame_id)}; the static transforms place it in {frame} at "
        f"x {x:.3f}, y {y:.3f}, z {z:.3f} m, yaw {yaw:.2f}, pitch {pitch:.2f}, roll {roll:.2f} "
        "degrees, which is not applied."
    )


def _name(frame_id: str) -> str:
    """Return a frame's name as in ROS 2, without the slash of early ROS 1."""
    return str(frame_id).lstrip("/")
