"""Bags of ROS 1 (``.bag``, format 2.0), read with `rosbags`."""

from __future__ import annotations

import heapq
import weakref
from pathlib import Path
from threading import Lock

from urbantwin.errors import InputError
from urbantwin.fidelity.readers.bags.message_file import (
    Located,
    MessageFile,
    Topic,
    as_input_error,
)

__all__ = ["MAGIC", "Ros1Bag"]

MAGIC = b"#ROSBAG V"
_EXPECTED = "a bag of ROS 1, closed as it should be (rosbag reindex mends others)"


class Ros1Bag(MessageFile):
    """A bag whose index has been read."""

    def __init__(self, path: Path, at: Path | None = None) -> None:
        """Read the index of a bag.

        Args:
            path: the file, for errors.
            at: where it lies unpacked, if it is packed.

        Raises:
            InputError: it is no bag, or cut, or damaged.
        """
        from rosbags.rosbag1 import Reader

        self.path = path
        self._lock = Lock()
        self._bag = Reader(at or path)
        with as_input_error(path, _EXPECTED):
            self._bag.open()
            weakref.finalize(self, self._bag.close)
            found: dict[Topic, list[list[Located]]] = {}
            for one in self._bag.connections:
                schema = one.msgdef.data.encode()
                topic = Topic.of_ros(one.topic, one.msgtype, "ros1", schema)
                entries = self._bag.indexes[one.id]
                found.setdefault(topic, []).append(
                    [Located(entry.time, (one, entry)) for entry in entries]
                )
        self.messages = {
            topic: list(heapq.merge(*parts, key=lambda located: located.time_ns))
            for topic, parts in found.items()
        }

    def read(self, one: Located) -> bytes:
        """Return the bytes of a message; see `MessageFile`."""
        connection, entry = one.at
        place = f"the chunk at byte {entry.chunk_pos}"
        with self._lock, as_input_error(self.path, _EXPECTED, place):
            # Several messages of a topic may have one time: the index tells them apart.
            alike = [
                which for which in self._bag.indexes[connection.id] if which.time == entry.time
            ]
            number = next(k for k, which in enumerate(alike) if tuple(which) == tuple(entry))
            found = self._bag.messages([connection], entry.time, entry.time + 1)
            for k, (_, _, data) in enumerate(found):
                if k == number:
                    return bytes(data)
        raise InputError("has no message where its index says", file=self.path, place=place)
