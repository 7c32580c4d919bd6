"""MCAP files: indexed by walking over their records; messages are read by location.

Source: the MCAP specification (mcap.dev/spec): records have one byte of kind and eight of length;
chunks hold records compressed together, followed by indexes of their messages. The walk reads no
message, needs no summary at the end, and therefore supports truncated recordings. Records are
parsed by `mcap`, Foxglove's library.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from urbantwin.artefact.arrays import may_unpack
from urbantwin.errors import InputError
from urbantwin.io.bags.files import Located, MessageFile, Topic
from urbantwin.io.trust import reading

__all__ = ["MCAP_MAGIC", "McapFile"]

MCAP_MAGIC = b"\x89MCAP0\r\n"
_EXPECTED = "an MCAP file"
_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _INDEX, _FOOTER = 0x03, 0x04, 0x05, 0x06, 0x07, 0x02
_RECORD = struct.Struct("<BQ")
#: Message header: channel, sequence number, times of recording and publication; then its bytes.
_MESSAGE_HEAD = struct.Struct("<HIQQ")
#: Index entry: time, and offset in the decompressed chunk.
_ENTRY = np.dtype([("time", "<u8"), ("offset", "<u8")])
#: Chunk header: times, decompressed size, checksum, and length of the compression's name.
_CHUNK_HEAD = struct.Struct("<QQQII")
_LONGEST_NAME = 16


class McapFile(MessageFile):
    """An indexed MCAP file."""

    def __init__(self, path: Path, at: Path | None = None) -> None:
        """Walk over the records of a file.

        Args:
            path: the file, for errors.
            at: the decompressed file, if it is compressed.

        Raises:
            InputError: it is no MCAP file, or damaged before its first message.
        """
        self.path, self._at = path, at or path
        self._schemas: dict[int, Any] = {}
        self._channels: dict[int, Any] = {}
        self._found: dict[int, list[Located]] = {}
        self._kept: tuple[int, bytes] = (-1, b"")
        with self._at.open("rb") as stream:
            if stream.read(len(MCAP_MAGIC)) != MCAP_MAGIC:
                raise InputError("is not an MCAP file", file=path, expected=_EXPECTED)
            self._walk(stream)
            for channel in sorted(set(self._found) - set(self._channels)):
                self._learn(stream, channel)
        self.messages = {}
        for number, located in sorted(self._found.items()):
            if number in self._channels:
                found = self.messages.setdefault(self._topic(number), [])
                found += located
                found.sort(key=lambda one: one.time_ns)

    def read(self, one: Located) -> bytes:
        """Return the bytes of a message; see `MessageFile`."""
        chunk, offset = one.at
        with self._at.open("rb") as stream:
            if chunk >= 0:
                data = self._unpacked(stream, chunk)
                where = f"byte {offset} of the chunk at byte {chunk}"
            else:
                stream.seek(offset)
                kind, length = _RECORD.unpack(stream.read(_RECORD.size))
                data, where = _RECORD.pack(kind, length) + stream.read(length), f"byte {offset}"
                offset = 0
        begin = offset + _RECORD.size
        kind, length = _RECORD.unpack_from(data, offset) if begin <= len(data) else (0, 0)
        if kind != _MESSAGE or length < _MESSAGE_HEAD.size or begin + length > len(data):
            raise InputError(
                "has no message where its index says", file=self.path, place=where,
                expected=_EXPECTED,
            )  # fmt: skip
        return bytes(data[begin + _MESSAGE_HEAD.size : begin + length])

    def _walk(self, stream: BinaryIO) -> None:
        size = self._at.stat().st_size
        at, chunk, indexed = len(MCAP_MAGIC), -1, True
        closed = False
        while at + _RECORD.size <= size and not closed:
            stream.seek(at)
            kind, length = _RECORD.unpack(stream.read(_RECORD.size))
            if at + _RECORD.size + length > size:
                break
            if chunk >= 0 and kind != _INDEX and not indexed:
                self._scan(stream, chunk)
            if kind == _CHUNK:
                chunk, indexed = at, False
            elif kind == _INDEX and chunk >= 0:
                indexed = True
                self._add_index(stream.read(length), at, chunk)
            else:
                chunk, indexed = (chunk, indexed) if kind == _INDEX else (-1, True)
                closed = kind == _FOOTER
                if kind == _MESSAGE and length >= _MESSAGE_HEAD.size:
                    channel, _, time, _ = _MESSAGE_HEAD.unpack(stream.read(_MESSAGE_HEAD.size))
                    self._found.setdefault(channel, []).append(Located(time, (-1, at)))
                elif kind in (_SCHEMA, _CHANNEL):
                    self._add_definition(kind, stream.read(length), f"byte {at}")
            at += _RECORD.size + length
        if not indexed:
            self._scan(stream, chunk)
        if not closed:
            self.notes = (f"The recording was cut at byte {at}: what is whole before it is read.",)

    def _add_index(self, body: bytes, at: int, chunk: int) -> None:
        with reading(self.path, _EXPECTED, f"byte {at}"):
            channel, length = struct.unpack_from("<HI", body)
            entries = np.frombuffer(body, _ENTRY, count=length // _ENTRY.itemsize, offset=6)
        self._found.setdefault(channel, []).extend(
            Located(time, (chunk, offset)) for time, offset in entries.tolist()
        )

    def _add_definition(self, kind: int, body: bytes, place: str) -> None:
        from mcap.data_stream import ReadDataStream
        from mcap.records import Channel, Schema

        with reading(self.path, _EXPECTED, place):
            stream = ReadDataStream(io.BytesIO(body))
            if kind == _SCHEMA:
                schema = Schema.read(stream)
                self._schemas.setdefault(schema.id, schema)
            else:
                channel = Channel.read(stream)
                self._channels.setdefault(channel.id, channel)

    def _learn(self, stream: BinaryIO, channel: int) -> None:
        """Read the definition of a channel from the first chunk with messages of it."""
        chunk, _ = self._found[channel][0].at
        if chunk >= 0:
            for kind, begin, end in self._records(stream, chunk):
                if kind in (_SCHEMA, _CHANNEL):
                    body = self._unpacked(stream, chunk)[begin:end]
                    self._add_definition(kind, body, f"the chunk at byte {chunk}")

    def _scan(self, stream: BinaryIO, chunk: int) -> None:
        """Index the messages of a chunk without an index."""
        for kind, begin, end in self._records(stream, chunk):
            data = self._unpacked(stream, chunk)
            if kind in (_SCHEMA, _CHANNEL):
                self._add_definition(kind, data[begin:end], f"the chunk at byte {chunk}")
            elif kind == _MESSAGE and end - begin >= _MESSAGE_HEAD.size:
                channel, _, time, _ = _MESSAGE_HEAD.unpack_from(data, begin)
                where = Located(time, (chunk, begin - _RECORD.size))
                self._found.setdefault(channel, []).append(where)

    def _records(self, stream: BinaryIO, chunk: int) -> Iterator[tuple[int, int, int]]:
        """Return kind, begin and end of the records of a chunk."""
        data = self._unpacked(stream, chunk)
        at = 0
        while at + _RECORD.size <= len(data):
            kind, length = _RECORD.unpack_from(data, at)
            begin = at + _RECORD.size
            if begin + length > len(data):
                return
            yield kind, begin, begin + length
            at = begin + length

    def _unpacked(self, stream: BinaryIO, chunk: int) -> bytes:
        """Return the records of a chunk; the last one is cached for sequential reads."""
        at, data = self._kept
        if at == chunk:
            return data
        place = f"the chunk at byte {chunk}"
        with reading(self.path, _EXPECTED, place):
            stream.seek(chunk)
            _, length = _RECORD.unpack(stream.read(_RECORD.size))
            body = stream.read(length)
            _, _, size, checksum, name = _CHUNK_HEAD.unpack_from(body)
            begin = _CHUNK_HEAD.size + name
            how = body[_CHUNK_HEAD.size : begin].decode() if name <= _LONGEST_NAME else "unknown"
            packed = memoryview(body)[begin + 8 :]
            if not may_unpack(size, len(packed)):
                raise ValueError(f"would unpack to {size} bytes")
            data = _unpack(how, packed, size)
            if len(data) != size:
                raise ValueError(f"unpacks to {len(data)} bytes instead of {size}")
            if checksum and zlib.crc32(data) != checksum:
                raise ValueError("its checksum is another")
        self._kept = (chunk, data)
        return data

    def _topic(self, number: int) -> Topic:
        channel = self._channels[number]
        schema = self._schemas.get(channel.schema_id)
        kind, definition = ("", b"") if schema is None else (schema.name, schema.data)
        if channel.message_encoding in ("ros1", "cdr") and "/" in kind:
            return Topic.of_ros(channel.topic, kind, channel.message_encoding, definition)
        return Topic(channel.topic, kind, channel.message_encoding, definition)


def _unpack(how: str, packed: memoryview, size: int) -> bytes:
    """Decompress a chunk to at most its declared size."""
    if not how or not size:
        return bytes(packed)
    if how == "zstd":
        import zstandard

        if zstandard.frame_content_size(packed) not in (-1, size):
            raise ValueError("says two sizes of itself")
        return zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)
    if how == "lz4":
        import lz4.frame

        unpacked: bytes = lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=size + 1)
        return unpacked
    raise ValueError(f"it is packed by {how}, which is unknown")
