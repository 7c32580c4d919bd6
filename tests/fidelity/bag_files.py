"""Bags of ROS and MCAP files, written by their own libraries: rosbags and mcap."""

import base64
import json

import numpy as np
from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

ROS1 = get_typestore(Stores.ROS1_NOETIC)
ROS2 = get_typestore(Stores.ROS2_HUMBLE)
CLOUD = "sensor_msgs/msg/PointCloud2"
#: Numbers of types, of ROS and of Foxglove.
OF_ROS = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}
OF_FOXGLOVE = {"u1": 1, "i1": 2, "u2": 3, "i2": 4, "u4": 5, "i4": 6, "f4": 7, "f8": 8}
SECOND = 10**9


def header(types, *, frame_id="os_lidar", second=0):
    """Return a header of either ROS."""
    kind = types.types["std_msgs/msg/Header"]
    stamp = types.types["builtin_interfaces/msg/Time"](second, 0)
    known = {"seq": second} if "seq" in kind.__dataclass_fields__ else {}
    return kind(**known, stamp=stamp, frame_id=frame_id)


def ros_cloud(types, table, *, big=False, height=1, row_step=None):
    """Return a PointCloud2 of a structured array, whose layout it takes over."""
    point_field, cloud = types.types["sensor_msgs/msg/PointField"], types.types[CLOUD]
    fields = [
        point_field(name=name, offset=offset, datatype=OF_ROS[kind.base.str[1:]],
                    count=int(np.prod(kind.shape)) if kind.shape else 1)
        for name, (kind, offset, *_) in table.dtype.fields.items()
    ]  # fmt: skip
    step, width = table.dtype.itemsize, len(table) // height
    row_step = row_step or step * width
    rows = (table.astype(table.dtype.newbyteorder(">")) if big else table).reshape(height, width)
    data = b"".join(row.tobytes() + bytes(row_step - step * width) for row in rows)
    known = {
        "header": header(types), "height": height, "width": width, "fields": fields,
        "is_bigendian": big, "point_step": step, "row_step": row_step,
        "data": np.frombuffer(data, np.uint8), "is_dense": True,
    }  # fmt: skip
    return cloud(**known)


def write_ros1(path, topics, *, packed=None):
    """Write a bag of ROS 1: topic -> (type, its definition or None, [(time ns, message)])."""
    bag = Writer1(path)
    if packed:
        bag.set_compression(Writer1.CompressionFormat[packed])
    with bag:
        _write(bag, topics, ROS1, lambda types, *message: types.serialize_ros1(*message))


def write_ros2(path, topics, *, storage="SQLITE3", packed=None):
    """Write the folder of a bag of ROS 2; see `write_ros1`."""
    bag = Writer2(path, version=9, storage_plugin=StoragePlugin[storage])
    if packed:
        bag.set_compression(CompressionMode[packed], CompressionFormat.ZSTD)
    with bag:
        _write(bag, topics, ROS2, lambda types, *message: types.serialize_cdr(*message))


def _write(bag, topics, types, pack):
    rows = []
    for name, (kind, definition, messages) in topics.items():
        if definition is not None:
            own = get_typestore(Stores.ROS1_NOETIC if types is ROS1 else Stores.ROS2_HUMBLE)
            own.register(get_types_from_msg(definition, kind))
        else:
            own = types
        connection = bag.add_connection(name, kind, typestore=own)
        rows += [
            (time, connection, pack(own, made(own) if callable(made) else made, kind))
            for time, made in messages
        ]
    for time, connection, data in sorted(rows, key=lambda row: row[0]):
        bag.write(connection, time, data)


def foxglove_json(table, **changed):
    """Return foxglove.PointCloud in JSON."""
    fields = [
        {"name": name, "offset": offset, "type": OF_FOXGLOVE[kind.str[1:]]}
        for name, (kind, offset) in table.dtype.fields.items()
    ]
    message = {
        "timestamp": {"sec": 5, "nsec": 0}, "frame_id": "lidar", "point_stride":
        table.dtype.itemsize, "fields": fields, "data": base64.b64encode(table.tobytes()).decode(),
    } | changed  # fmt: skip
    return json.dumps(message).encode()


def _file(files, name, *messages, needs=()):
    one = files.file.add(name=name, package="foxglove", syntax="proto3")
    one.dependency.extend(needs)
    for title, fields in messages:
        message = one.message_type.add(name=title)
        for number, (field, kind, *repeated) in enumerate(fields, 1):
            is_message = isinstance(kind, str)
            message.field.add(
                name=field, number=number, label=3 if repeated else 1,
                type=FieldDescriptorProto.TYPE_MESSAGE if is_message else kind,
                type_name=f".foxglove.{kind}" if is_message else None,
            )  # fmt: skip


def foxglove_schema():
    """Return foxglove.PointCloud's definition in protobuf, as Foxglove publishes it."""
    double, string, number, fixed, data = 1, 9, 5, 7, 12
    files = FileDescriptorSet()
    _file(files, "time", ("Time", [("seconds", 3), ("nanos", number)]))
    _file(files, "vector", ("Vector3", [(axis, double) for axis in "xyz"]))
    _file(files, "turn", ("Quaternion", [(axis, double) for axis in "xyzw"]))
    _file(files, "pose", ("Pose", [("position", "Vector3"), ("orientation", "Quaternion")]),
          needs=("vector", "turn"))  # fmt: skip
    _file(
        files,
        "field",
        ("PackedElementField", [("name", string), ("offset", fixed), ("type", number)]),
    )
    cloud = [
        ("timestamp", "Time"), ("frame_id", string), ("pose", "Pose"), ("point_stride", fixed),
        ("fields", "PackedElementField", True), ("data", data),
    ]  # fmt: skip
    _file(files, "cloud", ("PointCloud", cloud), needs=("time", "pose", "field"))
    return files


def foxglove_protobuf(table, *, position=None, orientation=None):
    """Return foxglove.PointCloud in protobuf."""
    pool = DescriptorPool()
    for one in foxglove_schema().file:
        pool.Add(one)
    message = GetMessageClass(pool.FindMessageTypeByName("foxglove.PointCloud"))()
    message.frame_id, message.point_stride = "lidar", table.dtype.itemsize
    message.data = table.tobytes()
    for name, (kind, offset) in table.dtype.fields.items():
        message.fields.add(name=name, offset=offset, type=OF_FOXGLOVE[kind.str[1:]])
    for part, values, axes in (("position", position, "xyz"), ("orientation", orientation, "xyzw")):
        for axis, value in zip(axes, values or (), strict=bool(values)):
            setattr(getattr(message.pose, part), axis, value)
    return message.SerializeToString()


def write_mcap(path, topics, **how):
    """Write an MCAP: topic -> (schema, encoding of it, its data, of messages, [(ns, bytes)])."""
    with path.open("wb") as stream:
        file = McapWriter(stream, **how)
        file.start()
        rows = []
        for name, (schema, encoding, data, of_messages, messages) in topics.items():
            number = file.register_schema(schema, encoding, data)
            channel = file.register_channel(name, of_messages, number)
            rows += [(time, channel, message) for time, message in messages]
        for time, channel, message in rows:
            file.add_message(channel, time, message, time)
        file.finish()
