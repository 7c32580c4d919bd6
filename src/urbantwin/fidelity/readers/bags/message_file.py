"""A file of messages by topic, whatever its container: what is in it, found before it is read."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from urbantwin.artefact.arrays import one_line
from urbantwin.errors import InputError
from urbantwin.fidelity.readers.bags.unpacking import ZSTD, unpacked_bytes

__all__ = ["Located", "Message", "MessageFile", "Topic", "as_input_error"]


@dataclass(frozen=True)
class Topic:
    """What messages of one name are.

    Attributes:
        name: ``/lidar/points``.
        kind: their type, ``sensor_msgs/msg/PointCloud2`` or ``foxglove.PointCloud``.
        encoding: ``ros1``, ``cdr``, ``protobuf`` or ``json``.
        schema: the definition of the type that the file holds; empty where it holds none.
    """

    name: str
    kind: str
    encoding: str
    schema: bytes = field(default=b"", compare=False)

    @classmethod
    def of_ros(cls, name: str, kind: str, encoding: str, schema: bytes = b"") -> Topic:
        """Return a topic of ROS; of ROS 1 the type is named as ROS 2 would."""
        parts = kind.split("/")
        return cls(name, "/".join((parts[0], "msg", parts[-1])), encoding, schema)


@dataclass(frozen=True)
class Located:
    """Where a message is.

    Attributes:
        time_ns: when it was recorded, nanoseconds from 1970.
        at: where it is, as its file knows it.
    """

    time_ns: int
    at: Any


class MessageFile(ABC):
    """A file that is open as long as this object is there; several threads may read.

    Attributes:
        path: the file.
        messages: where the messages of each topic are, in the order of their time.
        notes: what a reader of figures must know about the whole of it.
    """

    path: Path
    messages: dict[Topic, list[Located]]
    notes: tuple[str, ...] = ()

    @abstractmethod
    def read(self, one: Located) -> bytes:
        """Return the bytes of a message.

        Raises:
            InputError: it is damaged; says where.
        """


@dataclass(frozen=True)
class Message:
    """A message, and the file that it is in."""

    file: MessageFile
    topic: Topic
    located: Located

    def read(self) -> bytes:
        """Return its bytes, unpacked if each message was packed for itself."""
        data = self.file.read(self.located)
        if self.topic.encoding != "cdr" or not data.startswith(ZSTD):
            return data
        with as_input_error(self.file.path, "a message", str(self)):
            return unpacked_bytes(data)

    def __str__(self) -> str:
        """Return which one it is, for errors."""
        return f"{self.topic.name} at {self.located.time_ns} ns"


@contextmanager
def as_input_error(path: Path, expected: str, place: str | None = None) -> Iterator[None]:
    """Raise InputError for whatever a library says of a file that is damaged."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:  # of parsers and decoders, each of its own kind
        if isinstance(error, OSError) and error.errno is not None:  # of the system, not of bz2
            raise
        raise InputError(
            f"is not readable ({one_line(error)})", file=path, place=place, expected=expected
        ) from None
