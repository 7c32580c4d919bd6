"""Packets of an Ouster in a bag, a message each, as ``ouster_ros`` records them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from urbantwin.errors import InputError
from urbantwin.fidelity.readers.bags.message_file import Message, as_input_error
from urbantwin.fidelity.readers.bags.ros_types import OUSTER_PACKAGES, ros_message
from urbantwin.fidelity.readers.ouster import HEADER_BYTES, metadata_of, ouster_recording
from urbantwin.fidelity.readers.ouster_packets import (
    OusterFormat,
    ouster_format,
    read_ouster_format,
)
from urbantwin.fidelity.readers.recording import Recording
from urbantwin.strict_json import parse_json

__all__ = ["OUSTER", "is_of_lidar", "ouster_bag"]

#: Types of messages that hold a packet.
OUSTER = tuple(f"{package}/msg/PacketMsg" for package in OUSTER_PACKAGES)
_EXPECTED = "a packet of an Ouster"
#: Where the driver says what the unit is.
_TEXT, _METADATA = "std_msgs/msg/String", "metadata"
#: Packets of the inertial sensor, which has the same type, are no larger.
_INERTIAL_BYTES = 256


def is_of_lidar(message: Message) -> bool:
    """Return whether a message is one of the LiDAR's, by its size."""
    return len(message.read()) > _INERTIAL_BYTES


def ouster_bag(
    place: tuple[Path, Path, str], packets: Sequence[Message], others: Sequence[Message]
) -> Recording:
    """Return the recording in the packets of one topic; a frame is one turn of the sensor.

    Args:
        place: the recording as a person named it, its file, and its layout.
        packets: the topic's, in their order.
        others: the first message of each topic, among which the unit's metadata may be.

    Raises:
        InputError: nothing says what the unit is, or no packet is as large as it says.
    """
    file = place[1]
    form = _form(file, others)

    def begun() -> Iterator[tuple[Message, bytes]]:
        for one in packets:
            packet = _packet(one)
            if len(packet) == form.packet_size:
                yield one, packet[:HEADER_BYTES]

    if next(begun(), None) is None:
        raise InputError(
            f"holds no packet of {form.packet_size} bytes, which the metadata ask for",
            file=file,
            place=packets[0].topic.name,
            expected="the packets of this sensor",
        )
    return ouster_recording(place, form, begun(), lambda some: [_packet(one) for one in some])


def _packet(message: Message) -> bytes:
    with as_input_error(message.file.path, _EXPECTED, str(message)):
        return bytes(ros_message(message.topic, message.read()).buf)


def _form(file: Path, others: Sequence[Message]) -> OusterFormat:
    for one in others:
        if one.topic.kind == _TEXT and one.topic.name.endswith(_METADATA):
            with as_input_error(one.file.path, "the metadata of an Ouster", str(one)):
                document = parse_json(ros_message(one.topic, one.read()).data)
            return ouster_format(document, one.file.path)
    return read_ouster_format(metadata_of(file, "has packets of an Ouster, no topic of metadata"))
