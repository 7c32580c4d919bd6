"""Messages of ROS made objects, by the types that ROS comes with or that a file defines."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from urbantwin.fidelity.readers.bags.message_file import Topic

__all__ = ["LIVOX_PACKAGES", "OUSTER_PACKAGES", "ros_message"]

OUSTER_PACKAGES = ("ouster_ros", "ouster_sensor_msgs", "ouster_msgs")

LIVOX_PACKAGES = ("livox_ros_driver", "livox_ros_driver2", "livox_interfaces")

#: The cloud that all of Livox's drivers have.
_LIVOX = (
    "std_msgs/Header header\nuint64 timebase\nuint32 point_num\nuint8 lidar_id\nuint8[3] rsvd\n"
    "CustomPoint[] points\n",
    "{}/CustomPoint",
    "uint32 offset_time\nfloat32 x\nfloat32 y\nfloat32 z\n"
    "uint8 reflectivity\nuint8 tag\nuint8 line\n",
)
#: What drivers of LiDARs define for themselves: files of ROS 2 before Iron hold no definitions.
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
        f"{package}/msg/CustomMsg": (_LIVOX[0], _LIVOX[1].format(package), _LIVOX[2])
        for package in LIVOX_PACKAGES
    },
}
#: Definitions end so and are parsed; longer ones are no message's.
_MOST_BYTES = 1_000_000


def ros_message(topic: Topic, data: bytes) -> Any:  # noqa: ANN401 - its fields are those of its type
    """Return a message of ROS 1 or ROS 2.

    Raises:
        Exception: of the library, where the bytes are not such a message, or nobody defines it.
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
