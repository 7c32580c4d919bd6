"""What one node says to another: one message in each packet, decoded from its bytes alone.

A message is a header of 58 bytes and a payload; all numbers are little-endian.

====== ===== ======================================================================
offset type  field
====== ===== ======================================================================
0      4s    ``UTF1``: UrbanTwin fusion, version 1
4      u8    codec of the payload, see `CODECS`
5      u8    flags of the codec
6      u16   node, its number
8      u32   number of the node's frame
12     u16   number of this packet among those of the frame
14     u16   how many packets the frame has
16     i64   time stamp: the node's clock, microseconds
24     3i32  place of the payload's frame in the site as the node reports it, millimetres
36     3i32  its yaw, pitch and roll (ROS REP-103), microradians
48     u16   bytes of the payload
50     u32   reserved, 0
54     u32   CRC-32 (ISO-HDLC, as zlib's) of the header up to here and of the payload
58     ...   payload
====== ===== ======================================================================
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass

import numpy as np

from urbantwin.errors import InputError
from urbantwin.geometry import Pose, rotation_from_ypr, ypr_from_rotation

__all__ = ["CODECS", "HEADER_BYTES", "MOST_PAYLOAD", "Head", "Message", "bits_of", "pack", "unpack"]

_MAGIC = b"UTF1"
_HEADER = struct.Struct("<4sBBHIHHq3i3iHI")
_CRC = struct.Struct("<I")
HEADER_BYTES = _HEADER.size + _CRC.size
#: Longer payloads have no place in the header's field.
MOST_PAYLOAD = 65_535
#: Codec of a payload -> its number.
CODECS = {"voxel": 1, "octree": 2, "draco": 3, "features": 4, "boxes": 5, "moving": 6}
_NAMES = {number: name for name, number in CODECS.items()}
_EXPECTED = "a message of `urbantwin model fuse` (docs/fusion.md)"


@dataclass(frozen=True, eq=False)
class Head:
    """What all packets of one frame have in common.

    Attributes:
        node: number of who sends.
        frame: number of its frame.
        stamp_s: when the frame was taken by the node's clock, seconds; kept to a microsecond.
        site_SE3_payload: where the frame of the payload is in the site, as the node reports it;
            kept to a millimetre and a microradian.
    """

    node: int
    frame: int
    stamp_s: float
    site_SE3_payload: Pose  # noqa: N815


@dataclass(frozen=True, eq=False)
class Message:
    """One packet.

    Attributes:
        head: who sends what.
        codec: one of `CODECS`.
        packet: number of this packet among those of the frame and codec.
        packets: how many there are.
        payload: as the codec wrote it.
        flags: of the codec.
    """

    head: Head
    codec: str
    packet: int
    packets: int
    payload: bytes
    flags: int = 0


def pack(message: Message) -> bytes:
    """Return the bytes of a message.

    Raises:
        ValueError: a number has no place in its field: a caller's mistake.
    """
    if len(message.payload) > MOST_PAYLOAD:
        raise ValueError(f"a payload of {len(message.payload)} bytes")
    told, pose = message.head, message.head.site_SE3_payload
    place = np.rint(pose.translation * 1e3).astype(np.int64).tolist()
    angles = [round(one * 1e6) for one in ypr_from_rotation(pose.rotation)]
    head = _HEADER.pack(
        _MAGIC,
        CODECS[message.codec],
        message.flags,
        told.node,
        told.frame,
        message.packet,
        message.packets,
        round(told.stamp_s * 1e6),
        *place,
        *angles,
        len(message.payload),
        0,
    )
    return head + _CRC.pack(zlib.crc32(message.payload, zlib.crc32(head))) + message.payload


def unpack(data: bytes) -> Message:
    """Return the message that bytes hold.

    Raises:
        InputError: they are no whole message of this version, or are damaged.
    """
    if len(data) < HEADER_BYTES:
        raise _bad(f"has {len(data)} bytes, fewer than its header's {HEADER_BYTES}")
    magic, codec, flags, node, frame, packet, packets, stamp, *pose, size, _ = _HEADER.unpack_from(
        data
    )
    if magic[:3] != _MAGIC[:3]:
        raise _bad("does not begin with UTF1")
    if magic != _MAGIC:
        raise _bad(f"is of version {magic[3:].decode('latin-1')!r}, which is not known here")
    if len(data) != HEADER_BYTES + size:
        raise _bad(f"has {len(data) - HEADER_BYTES} bytes of payload, its header says {size}")
    (crc,) = _CRC.unpack_from(data, _HEADER.size)
    if zlib.crc32(data[HEADER_BYTES:], zlib.crc32(data[: _HEADER.size])) != crc:
        raise _bad("is damaged (its CRC differs)")
    if codec not in _NAMES:
        raise _bad(f"has codec {codec}, which is not known here")
    if packet >= packets:
        raise _bad(f"is packet {packet} of {packets}")
    place, angles = np.array(pose[:3]) * 1e-3, np.array(pose[3:]) * 1e-6
    return Message(
        head=Head(node, frame, stamp * 1e-6, Pose(rotation_from_ypr(*angles), place)),
        codec=_NAMES[codec],
        packet=packet,
        packets=packets,
        payload=data[HEADER_BYTES:],
        flags=flags,
    )


def bits_of(packets: list[bytes]) -> int:
    """Return how many bits packets have, headers included."""
    return 8 * sum(len(one) for one in packets)


def _bad(problem: str) -> InputError:
    return InputError(problem, place="message", expected=_EXPECTED)
