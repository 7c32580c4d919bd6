"""Files of messages by topic: bags of ROS 1 (``.bag``) and of ROS 2 in SQLite (``.db3``).

Source: ros2/rosbag2, ``rosbag2_storage_sqlite3``; ROS 1 is read with `rosbags`. ROS 2 may compress
messages or whole files with zstd. A file is indexed when it is opened; messages are read on demand.
"""

from __future__ import annotations

import heapq
import shutil
import sqlite3
import weakref
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import mkdtemp
from threading import Lock
from typing import Any
from urllib.parse import quote

from urbantwin.artefact.arrays import may_unpack
from urbantwin.errors import InputError
from urbantwin.io.trust import reading

__all__ = [
    "PACKED",
    "ROS1_MAGIC",
    "SQLITE_MAGIC",
    "Located",
    "Message",
    "MessageFile",
    "Ros1Bag",
    "SqliteBag",
    "Topic",
    "unpacked_file",
]

#: Suffix of a compressed file, and magic bytes of compressed data.
PACKED = ".zstd"
ZSTD = b"\x28\xb5\x2f\xfd"
_PIECE = 1 << 20


def unpacked_bytes(data: bytes) -> bytes:
    """Return decompressed bytes.

    Raises:
        ValueError: the size is missing or implausible.
        Exception: of the library, if the data are damaged.
    """
    import zstandard

    size = zstandard.frame_content_size(data)
    if size < 0 or not may_unpack(size, len(data)):
        raise ValueError("does not say how large it is, or far too large")
    unpacked: bytes = zstandard.ZstdDecompressor().decompress(data)
    return unpacked


def unpacked_file(file: Path) -> Path | None:
    """Decompress a file into a new temporary folder; return None if it is not compressed.

    Raises:
        InputError: it is damaged, or decompresses to far more than its size.
    """
    if file.suffix.lower() != PACKED:
        return None
    import zstandard

    size, written = file.stat().st_size, 0
    folder = Path(mkdtemp(prefix="urbantwin-"))
    at = folder / file.stem
    try:
        with file.open("rb") as packed, at.open("wb") as stream:
            for piece in zstandard.ZstdDecompressor().read_to_iter(packed, write_size=_PIECE):
                written += len(piece)
                if not may_unpack(written, size):
                    raise InputError("unpacks to far more than its size", file=file)
                stream.write(piece)
    except BaseException as error:
        shutil.rmtree(folder, ignore_errors=True)
        if isinstance(error, zstandard.ZstdError):
            problem = f"is damaged ({error})"
            raise InputError(problem, file=file, expected="a file of zstd") from None
        raise
    return at


@dataclass(frozen=True)
class Topic:
    """The type of a topic's messages.

    Attributes:
        name: ``/lidar/points``.
        kind: their type, ``sensor_msgs/msg/PointCloud2`` or ``foxglove.PointCloud``.
        encoding: ``ros1``, ``cdr``, ``protobuf`` or ``json``.
        schema: definition of the type in the file; empty if it has none.
    """

    name: str
    kind: str
    encoding: str
    schema: bytes = field(default=b"", compare=False)

    @classmethod
    def of_ros(cls, name: str, kind: str, encoding: str, schema: bytes = b"") -> Topic:
        """Return a ROS topic; types of ROS 1 are named as in ROS 2."""
        parts = kind.split("/")
        return cls(name, "/".join((parts[0], "msg", parts[-1])), encoding, schema)


@dataclass(frozen=True)
class Located:
    """The location of a message.

    Attributes:
        time_ns: time of recording, nanoseconds since 1970.
        at: position in its file, specific to the format.
    """

    time_ns: int
    at: Any


class MessageFile(ABC):
    """A file that is open during the lifetime of this object; reads are thread-safe.

    Attributes:
        path: the file.
        messages: locations of the messages of each topic, in order of time.
        notes: notes about the whole file that qualify results.
    """

    path: Path
    messages: dict[Topic, list[Located]]
    notes: tuple[str, ...] = ()

    @abstractmethod
    def read(self, one: Located) -> bytes:
        """Return the bytes of a message.

        Raises:
            InputError: it is damaged; the error gives the position.
        """


@dataclass(frozen=True)
class Message:
    """A message, and its file."""

    file: MessageFile
    topic: Topic
    located: Located

    def read(self) -> bytes:
        """Return its bytes, decompressed if messages are compressed individually."""
        data = self.file.read(self.located)
        if self.topic.encoding != "cdr" or not data.startswith(ZSTD):
            return data
        with reading(self.file.path, "a message", str(self)):
            return unpacked_bytes(data)

    def __str__(self) -> str:
        """Return its topic and time, for errors."""
        return f"{self.topic.name} at {self.located.time_ns} ns"


SQLITE_MAGIC = b"SQLite format 3\x00"
_SQLITE = "a .db3 of ROS 2"


class SqliteBag(MessageFile):
    """An indexed file of a ROS 2 bag."""

    def __init__(self, path: Path, at: Path | None = None) -> None:
        """Index the messages.

        Args:
            path: the file, for errors.
            at: the decompressed file, if it is compressed.

        Raises:
            InputError: it is no such file, or damaged.
        """
        self.path, self._at = path, at or path
        with self._open() as database:
            tables = {name for (name,) in database.execute("SELECT name FROM sqlite_master")}
            if not {"topics", "messages"} <= tables:
                raise InputError("has no tables topics and messages", file=path, expected=_SQLITE)
            schemas = {}
            if "message_definitions" in tables:
                told = "SELECT topic_type, encoded_message_definition FROM message_definitions"
                schemas = {kind: str(text).encode() for kind, text in database.execute(told)}
            topics = database.execute("SELECT id, name, type, serialization_format FROM topics")
            self.messages = {}
            for number, name, kind, encoding in topics.fetchall():
                topic = Topic.of_ros(str(name), str(kind), str(encoding), schemas.get(kind, b""))
                rows = database.execute(
                    "SELECT timestamp, id FROM messages WHERE topic_id = ? ORDER BY timestamp, id",
                    (number,),
                )
                found = self.messages.setdefault(topic, [])
                found += [Located(int(time), int(row)) for time, row in rows]
                found.sort(key=lambda one: one.time_ns)

    def read(self, one: Located) -> bytes:
        """Return the bytes of a message; see `MessageFile`."""
        with self._open(f"message {one.at}") as database:
            row = database.execute("SELECT data FROM messages WHERE id = ?", (one.at,)).fetchone()
        if row is None or not isinstance(row[0], bytes):
            raise InputError("has no bytes", file=self.path, place=f"message {one.at}")
        return row[0]

    @contextmanager
    def _open(self, place: str | None = None) -> Iterator[sqlite3.Connection]:
        """Open the file for one thread, without writing anything, not even beside it."""
        # Data of a recorder that is still writing are in a file beside it.
        alone = not self._at.with_name(self._at.name + "-wal").exists()
        where = f"file:{quote(str(self._at))}?mode=ro" + ("&immutable=1" if alone else "")
        with (
            reading(self.path, _SQLITE, place),
            closing(sqlite3.connect(where, uri=True)) as database,
        ):
            yield database


ROS1_MAGIC = b"#ROSBAG V"
_ROS1 = "a bag of ROS 1, closed as it should be (rosbag reindex mends others)"


class Ros1Bag(MessageFile):
    """An indexed ROS 1 bag."""

    def __init__(self, path: Path, at: Path | None = None) -> None:
        """Read the index of a bag.

        Args:
            path: the file, for errors.
            at: the decompressed file, if it is compressed.

        Raises:
            InputError: it is no bag, or truncated, or damaged.
        """
        from rosbags.rosbag1 import Reader

        self.path = path
        self._lock = Lock()
        self._bag = Reader(at or path)
        with reading(path, _ROS1):
            self._bag.open()
            weakref.finalize(self, self._bag.close)
            found: dict[Topic, list[list[Located]]] = {}
            for connection in self._bag.connections:
                schema = connection.msgdef.data.encode()
                topic = Topic.of_ros(connection.topic, connection.msgtype, "ros1", schema)
                entries = self._bag.indexes[connection.id]
                found.setdefault(topic, []).append(
                    [Located(entry.time, (connection, entry)) for entry in entries]
                )
        self.messages = {
            topic: list(heapq.merge(*parts, key=lambda located: located.time_ns))
            for topic, parts in found.items()
        }

    def read(self, one: Located) -> bytes:
        """Return the bytes of a message; see `MessageFile`."""
        connection, entry = one.at
        place = f"the chunk at byte {entry.chunk_pos}"
        with self._lock, reading(self.path, _ROS1, place):
            # Several messages of a topic may have the same time: the index distinguishes them.
            alike = [
                which for which in self._bag.indexes[connection.id] if which.time == entry.time
            ]
            number = next(k for k, which in enumerate(alike) if tuple(which) == tuple(entry))
            found = self._bag.messages([connection], entry.time, entry.time + 1)
            for k, (_, _, data) in enumerate(found):
                if k == number:
                    return bytes(data)
        raise InputError("has no message where its index says", file=self.path, place=place)
