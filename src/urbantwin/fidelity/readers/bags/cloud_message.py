"""Messages that are clouds: ``sensor_msgs/PointCloud2``, Foxglove's ``PointCloud`` and Livox's own.

Sources: ROS, ``sensor_msgs/PointCloud2.msg`` and ``PointField.msg``; Foxglove, "PointCloud schema"
(docs.foxglove.dev/docs/visualization/message-schemas/point-cloud) in protobuf and in JSON; Livox,
livox_ros_driver, README.md ("Livox custom msg format").
"""

from __future__ import annotations

import base64
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.fidelity.cloud_formats import organised
from urbantwin.fidelity.readers.bags.message_file import Topic, as_input_error
from urbantwin.fidelity.readers.bags.ros_types import LIVOX_PACKAGES, ros_message
from urbantwin.fidelity.readers.labels import pose_of_quaternion
from urbantwin.geometry import Pose
from urbantwin.strict_json import parse_json

__all__ = ["CLOUDS", "CloudMessage", "cloud_message", "pose_of"]

_POINT_CLOUD2 = "sensor_msgs/msg/PointCloud2"
_FOXGLOVE = ("foxglove.PointCloud", "foxglove_msgs/msg/PointCloud", "foxglove/PointCloud")
#: Types of messages that are clouds.
_LIVOX = tuple(f"{package}/msg/CustomMsg" for package in LIVOX_PACKAGES)
CLOUDS = (_POINT_CLOUD2, *_FOXGLOVE, *_LIVOX)
_ENCODINGS = ("ros1", "cdr", "protobuf", "json")
#: Numbers of types: PointField's, and those of Foxglove's PackedElementField.
_OF_ROS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
_OF_FOXGLOVE = {1: "u1", 2: "i1", 3: "u2", 4: "i2", 5: "u4", 6: "i4", 7: "f4", 8: "f8"}
_EXPECTED = "a cloud"


@dataclass(frozen=True, eq=False)
class CloudMessage:
    """A cloud as its message has it.

    Attributes:
        fields: arrays (N,) by name in lower case.
        frame_id: the frame of the points.
        place: where the sensor is in that frame, metres; None where the message does not say.
    """

    fields: dict[str, NDArray[np.generic]]
    frame_id: str
    place: NDArray[np.float64] | None = None


def cloud_message(topic: Topic, data: bytes, file: Path, place: str) -> CloudMessage:
    """Read the cloud in a message.

    Args:
        topic: what the message is.
        data: its bytes.
        file: it is from, for errors.
        place: in the file, for errors.

    Raises:
        InputError: the bytes are not such a message, or a field lies outside of a point.
    """
    if topic.encoding not in _ENCODINGS:
        raise InputError(
            f"is encoded as {topic.encoding or 'nothing'}, which is unknown",
            file=file,
            place=place,
            expected=", ".join(_ENCODINGS),
        )
    with as_input_error(file, _EXPECTED, place):
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
    """Return the fields of points that lie row by row in bytes.

    Args:
        data: the bytes.
        layout: name, byte in a point, type and number of values of each field.
        shape: rows, and points in each.
        steps: bytes from row to row, and from point to point.
    """
    (height, width), (row, step) = shape, steps
    if height * width and step <= 0:
        raise ValueError("has points of 0 bytes")
    # Of one row, drivers leave the step as they like.
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
        # A vector, or bytes that only fill up, is nothing of a frame.
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
    """Return where the points' own frame is; None where it is none."""
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
    """Return the pose of a position and a quaternion; of one that is zero, no turn.

    Raises:
        ValueError: a number is not finite.
    """
    if not np.isfinite([*xyz, *xyzw]).all():
        raise ValueError("has a pose that is not finite")
    x, y, z, w = xyzw if any(xyzw) else (0.0, 0.0, 0.0, 1.0)
    return pose_of_quaternion(w, x, y, z, xyz)
