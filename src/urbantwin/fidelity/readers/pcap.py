"""UDP datagrams in a pcap file: where their bytes are, fragments put together.

Source: the libpcap file format (draft-ietf-opsawg-pcap), RFC 791 (IPv4), RFC 768 (UDP). A large
LiDAR packet travels as several fragments.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path

from urbantwin.errors import InputError

__all__ = ["Datagram", "datagrams_in"]

#: Where the bytes of one datagram's payload are in the file: (begin, end), one after the other.
Datagram = tuple[tuple[int, int], ...]

#: First four bytes -> byte order; times in microseconds or nanoseconds.
_MAGIC = {
    b"\xd4\xc3\xb2\xa1": "<",
    b"\xa1\xb2\xc3\xd4": ">",
    b"\x4d\x3c\xb2\xa1": "<",
    b"\xa1\xb2\x3c\x4d": ">",
}
_PCAPNG = b"\x0a\x0d\x0d\x0a"
_EXPECTED = "a pcap file"
#: Link type -> bytes before the network layer, and where among them its protocol is.
_LINKS: dict[int, tuple[int, int | None]] = {
    0: (4, None),
    1: (14, 12),
    101: (0, None),
    108: (4, None),
    113: (16, 14),
    228: (0, None),
    276: (20, 0),
}
_IPV4, _VLAN, _UDP = 0x0800, 0x8100, 17
_UDP_HEADER = 8
#: Datagrams whose fragments are waited for at a time; of older ones some were lost.
_MOST_OPEN = 256


def datagrams_in(path: Path, data: memoryview) -> Iterator[Datagram]:
    """Return where the UDP payloads of a capture are, in their order.

    A packet that was cut at the end of the file is left out.

    Args:
        path: for errors.
        data: the file's bytes.

    Raises:
        InputError: not a pcap file, or one of an unknown link type.
    """
    if bytes(data[:4]) == _PCAPNG:
        raise InputError(
            "is a pcapng file",
            file=path,
            expected=f"{_EXPECTED} (editcap -F pcap IN OUT writes one)",
        )
    order = _MAGIC.get(bytes(data[:4]))
    if order is None or len(data) < 24:
        raise InputError("is not a pcap file", file=path, expected=_EXPECTED)
    link = struct.unpack_from(order + "I", data, 20)[0] & 0xFFFF
    if link not in _LINKS:
        raise InputError(f"is of link type {link}", file=path, expected="Ethernet or raw IP")
    fragments = _Fragments()
    at = 24
    while at + 16 <= len(data):
        size = struct.unpack_from(order + "8xI", data, at)[0]
        begin, end = at + 16, at + 16 + size
        if end > len(data):
            return
        at = end
        inside = _network(data, begin, end, link)
        if inside is not None:
            found = fragments.add(data, *inside)
            if found is not None:
                yield found


def _network(data: memoryview, begin: int, end: int, link: int) -> tuple[int, int] | None:
    """Return where the IPv4 packet of a captured frame is, None for anything else."""
    header, protocol_at = _LINKS[link]
    start = begin + header
    if start + 20 > end:
        return None
    if protocol_at is not None:
        protocol = struct.unpack_from(">H", data, begin + protocol_at)[0]
        if protocol == _VLAN and start + 24 <= end:
            protocol = struct.unpack_from(">H", data, start + 2)[0]
            start += 4
        if protocol != _IPV4:
            return None
    return (start, end) if data[start] >> 4 == 4 else None


class _Fragments:
    """Datagrams of which not all fragments have come."""

    def __init__(self) -> None:
        self._open: dict[bytes, dict[int, tuple[int, int]]] = {}
        self._length: dict[bytes, int] = {}

    def add(self, data: memoryview, start: int, end: int) -> Datagram | None:
        """Take one IPv4 packet; return the payload of the datagram that it makes whole."""
        total, identity, flags = struct.unpack_from(">HHH", data, start + 2)
        begin = start + 4 * (data[start] & 0xF)
        # Of a segment that the network card is yet to cut, some systems capture no length.
        stop = min(end, start + total) if total else end
        if data[start + 9] != _UDP or begin >= stop:
            return None
        offset, more = 8 * (flags & 0x1FFF), bool(flags & 0x2000)
        if not offset and not more:
            return self._payload([(begin, stop)])
        key = bytes(data[start + 12 : start + 20]) + identity.to_bytes(2, "big")
        parts = self._open.setdefault(key, {})
        parts[offset] = (begin, stop)
        if not more:
            self._length[key] = offset + stop - begin
        if self._is_whole(key):
            self._length.pop(key)
            return self._payload([part for _, part in sorted(self._open.pop(key).items())])
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
    def _payload(parts: list[tuple[int, int]]) -> Datagram | None:
        begin, end = parts[0]
        if end - begin < _UDP_HEADER:
            return None
        return ((begin + _UDP_HEADER, end), *parts[1:])
