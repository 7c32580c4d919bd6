"""Files of ROS 2 bags in SQLite (``.db3``): tables ``topics`` and ``messages``.

Source: ros2/rosbag2, ``rosbag2_storage_sqlite3``. A message is read when it is asked for.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from urllib.parse import quote

from urbantwin.errors import InputError
from urbantwin.fidelity.readers.bags.message_file import (
    Located,
    MessageFile,
    Topic,
    as_input_error,
)

__all__ = ["MAGIC", "SqliteBag"]

MAGIC = b"SQLite format 3\x00"
_EXPECTED = "a .db3 of ROS 2"


class SqliteBag(MessageFile):
    """A file of which it is known what is in it."""

    def __init__(self, path: Path, at: Path | None = None) -> None:
        """Read which messages there are, and when.

        Args:
            path: the file, for errors.
            at: where it lies unpacked, if it is packed.

        Raises:
            InputError: it is no such file, or damaged.
        """
        self.path, self._at = path, at or path
        with self._open() as database:
            tables = {name for (name,) in database.execute("SELECT name FROM sqlite_master")}
            if not {"topics", "messages"} <= tables:
                raise InputError("has no tables topics and messages", file=path, expected=_EXPECTED)
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
        """Open it for one thread; nothing is written, not even beside it."""
        # What a recorder that is still writing has not moved into the file stands beside it.
        alone = not self._at.with_name(self._at.name + "-wal").exists()
        where = f"file:{quote(str(self._at))}?mode=ro" + ("&immutable=1" if alone else "")
        with (
            as_input_error(self.path, _EXPECTED, place),
            closing(sqlite3.connect(where, uri=True)) as database,
        ):
            yield database
