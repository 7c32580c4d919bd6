"""UDP datagrams in a pcap or pcapng file: locations of their bytes, with fragments reassembled.

Source: the libpcap file format (draft-ietf-opsawg-pcap), pcapng (draft-ietf-opsawg-pcapng), RFC 791
(IPv4), RFC 768 (UDP). A large LiDAR packet is sent in several fragments.
"""

from __future__ import annotations

import mmap
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, NamedTuple

from urbantwin.errors import InputError

__all__ = ["Datagram", "datagrams_in", "is_pcap", "mapped", "payload_of"]


class Datagram(NamedTuple):
    """Location and addresses of one datagram's payload.

    Attributes:
        parts: (begin, end) of its bytes in the file, in sequence.
        source: source address.
        port: destination port.
        stamp_s: time of capture, seconds since 1970; 0 if unknown.
    """

    parts: tuple[tuple[int, int], ...]
    source: str
    port: int
    stamp_s: float

    @property
    def size(self) -> int:
        """Number of bytes of its payload."""
        return sum(end - begin for begin, end in self.parts)


#: Magic bytes -> byte order, and clock steps per second.
_MAGIC = {
    b"\xd4\xc3\xb2\xa1": ("<", 1e6),
    b"\xa1\xb2\xc3\xd4": (">", 1e6),
    b"\x4d\x3c\xb2\xa1": ("<", 1e9),
    b"\xa1\xb2\x3c\x4d": (">", 1e9),
}
_PCAPNG = b"\x0a\x0d\x0d\x0a"
#: Block types of pcapng: a section, an interface, packets in three forms; and one option.
_SECTION, _INTERFACE, _PACKET, _SIMPLE, _ENHANCED = 0x0A0D0D0A, 1, 2, 3, 6
_RESOLUTION = 9
_EXPECTED = "a pcap or pcapng file"
#: Link type -> size of the link header, and offset of the protocol in it.
_LINKS: dict[int, tuple[int, int | None]] = {
    0: (4, None),
    1: (14, 12),
    101: (0, None),
    108: (4, None),
    113: (16, 14),
    228: (0, None),
    276: (20, 0),
}
_IPV4, _UDP = 0x0800, 17
#: Protocols of 4 byte tags before the next protocol (IEEE 802.1Q, 802.1ad, and older ones); a frame
#: may have several.
_VLAN = (0x8100, 0x88A8, 0x9100, 0x9200)
_UDP_HEADER = 8
#: Maximum number of incomplete datagrams; the oldest is dropped as lost.
_MOST_OPEN = 256

#: A captured frame: begin, end, link type, time.
_Captured = tuple[int, int, int, float]


def is_pcap(path: Path) -> bool:
    """Return whether a file has the magic bytes of pcap or pcapng."""
    with path.open("rb") as stream:
        start = stream.read(4)
    return start in _MAGIC or start == _PCAPNG


@contextmanager
def mapped(path: Path) -> Iterator[memoryview]:
    """Provide the memory-mapped bytes of a file.

    Raises:
        InputError: it is empty.
    """
    if not path.stat().st_size:
        raise InputError("is empty", file=path, expected=_EXPECTED)
    with (
        path.open("rb") as stream,
        mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as whole,
        memoryview(whole) as data,
    ):
        yield data


def payload_of(stream: BinaryIO, one: Datagram) -> bytes:
    """Return the payload of a datagram from its file."""
    parts = []
    for begin, end in one.parts:
        stream.seek(begin)
        parts.append(stream.read(end - begin))
    return b"".join(parts)


def datagrams_in(path: Path, data: memoryview) -> Iterator[Datagram]:
    """Yield the UDP datagrams of a capture, in order.

    A packet truncated at the end of the file is left out.

    Args:
        path: the file, for errors.
        data: the file's bytes.

    Raises:
        InputError: not such a file, or one of an unknown link type.
    """
    if bytes(data[:4]) == _PCAPNG:
        captured = _in_pcapng(path, data)
    elif bytes(data[:4]) in _MAGIC and len(data) >= 24:
        captured = _in_pcap(data)
    else:
        raise InputError("is not a pcap file", file=path, expected=_EXPECTED)
    fragments = _Fragments()
    for begin, end, link, stamp in captured:
        if link not in _LINKS:
            raise InputError(f"is of link type {link}", file=path, expected="Ethernet or raw IP")
        inside = _network(data, begin, end, link)
        if inside is not None:
            found = fragments.add(data, *inside, stamp)
            if found is not None:
                yield found


def _in_pcap(data: memoryview) -> Iterator[_Captured]:
    order, steps = _MAGIC[bytes(data[:4])]
    link = struct.unpack_from(order + "I", data, 20)[0] & 0xFFFF
    at = 24
    while at + 16 <= len(data):
        seconds, fraction, size = struct.unpack_from(order + "III", data, at)
        begin, end = at + 16, at + 16 + size
        if end > len(data):
            return
        at = end
        yield begin, end, link, seconds + fraction / steps


def _in_pcapng(path: Path, data: memoryview) -> Iterator[_Captured]:
    """Yield the frames of the blocks: type, length, content, length again."""
    order, at = "<", 0
    links: list[tuple[int, float]] = []
    while at + 12 <= len(data):
        if bytes(data[at : at + 4]) == _PCAPNG:
            order = "<" if bytes(data[at + 8 : at + 12]) == b"\x4d\x3c\x2b\x1a" else ">"
            links = []
        kind, length = struct.unpack_from(order + "II", data, at)
        if length < 12 or length % 4:
            problem = f"is damaged: a block of {length} bytes"
            raise InputError(problem, file=path, place=f"byte {at}", expected="a pcapng file")
        if at + length > len(data):
            return
        body, stop = at + 8, at + length - 4
        at += length
        if kind == _INTERFACE and stop - body >= 8:
            link = struct.unpack_from(order + "H", data, body)[0]
            links.append((link, _steps_of(data[body + 8 : stop], order)))
        elif kind in (_ENHANCED, _PACKET) and stop - body >= 20:
            which = struct.unpack_from(order + ("I" if kind == _ENHANCED else "H"), data, body)[0]
            high, low, size = struct.unpack_from(order + "III", data, body + 4)
            if which < len(links) and body + 20 + size <= stop:
                link, steps = links[which]
                yield body + 20, body + 20 + size, link, ((high << 32) + low) / steps
        elif kind == _SIMPLE and stop - body >= 4 and links:
            size = min(struct.unpack_from(order + "I", data, body)[0], stop - body - 4)
            yield body + 4, body + 4 + size, links[0][0], 0.0


def _steps_of(options: memoryview, order: str) -> float:
    """Return the clock steps per second of an interface: if_tsresol, or 10^6."""
    at = 0
    while at + 4 <= len(options):
        code, length = struct.unpack_from(order + "HH", options, at)
        if code == _RESOLUTION and length == 1 and at + 4 < len(options):
            value = options[at + 4]
            return float(2 ** (value & 0x7F) if value & 0x80 else 10 ** min(value, 30))
        at += 4 + (length + 3) // 4 * 4
    return 1e6


def _network(data: memoryview, begin: int, end: int, link: int) -> tuple[int, int] | None:
    """Return the location of the IPv4 packet of a captured frame, None for other protocols."""
    header, protocol_at = _LINKS[link]
    start = begin + header
    if start + 20 > end:
        return None
    if protocol_at is not None:
        protocol = struct.unpack_from(">H", data, begin + protocol_at)[0]
        while protocol in _VLAN and start + 24 <= end:
            protocol = struct.unpack_from(">H", data, start + 2)[0]
            start += 4
        if protocol != _IPV4:
            return None
    return (start, end) if data[start] >> 4 == 4 else None


class _Fragments:
    """Incomplete datagrams."""

    def __init__(self) -> None:
        self._open: dict[bytes, dict[int, tuple[int, int]]] = {}
        self._length: dict[bytes, int] = {}

    def add(self, data: memoryview, start: int, end: int, stamp: float) -> Datagram | None:
        """Add an IPv4 packet; return the payload of the datagram if it is complete."""
        total, identity, flags = struct.unpack_from(">HHH", data, start + 2)
        begin = start + 4 * (data[start] & 0xF)
        # With segmentation offload, some systems capture no length.
        stop = min(end, start + total) if total else end
        if data[start + 9] != _UDP or begin >= stop:
            return None
        offset, more = 8 * (flags & 0x1FFF), bool(flags & 0x2000)
        if not offset and not more:
            return self._payload(data, start, [(begin, stop)], stamp)
        key = bytes(data[start + 12 : start + 20]) + identity.to_bytes(2, "big")
        parts = self._open.setdefault(key, {})
        parts[offset] = (begin, stop)
        if not more:
            self._length[key] = offset + stop - begin
        if self._is_whole(key):
            self._length.pop(key)
            whole = [part for _, part in sorted(self._open.pop(key).items())]
            return self._payload(data, start, whole, stamp)
        if len(self._open) > _MOST_OPEN:
            oldest = next(iter(self._open))
            self._open.pop(oldest)
            self._length.pop(oldest, None)
        return None

    def _is_whole(self, key: bytes) -> bool:
        reached = 0
        for offset, (begin, end) in sorted(self._open[key].items()):
            if offset != reached:
                return False
            reached += end - begin
        return reached == self._length.get(key)

    @staticmethod
    def _payload(
        data: memoryview, start: int, parts: list[tuple[int, int]], stamp: float
    ) -> Datagram | None:
        begin, end = parts[0]
        if end - begin < _UDP_HEADER:
            return None
        source = ".".join(map(str, data[start + 12 : start + 16]))
        port = struct.unpack_from(">H", data, begin + 2)[0]
        return Datagram(((begin + _UDP_HEADER, end), *parts[1:]), source, port, stamp)
