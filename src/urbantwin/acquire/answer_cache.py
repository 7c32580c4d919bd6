"""Cache of server responses: contents by SHA-256, and the content of each request.

Several runs may share a folder: files are written atomically.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from platformdirs import user_cache_path

from urbantwin.download import keep_bytes, kept_bytes
from urbantwin.strict_json import NotJsonError, parse_json

__all__ = ["AnswerCache", "KeptAnswer", "usual_cache"]

_EXPECTED = "a folder of your own with room: --cache DIR"


def usual_cache() -> Path:
    """Return the default cache folder."""
    return user_cache_path("urbantwin", appauthor=False) / "fetched"


@dataclass(frozen=True)
class KeptAnswer:
    """A cached response.

    Attributes:
        sha256: SHA-256 of the content.
        at: time of the response, UTC, ISO 8601.
        version: version of the file; empty if unknown.
        total: size of the whole file, bytes.
    """

    sha256: str
    at: str
    version: str
    total: int

    def is_fresh(self, days: float) -> bool:
        """Return whether the response is at most ``days`` old."""
        return datetime.now(UTC) - datetime.fromisoformat(self.at) <= timedelta(days=days)


class AnswerCache:
    """A folder of cached responses.

    Args:
        folder: the folder, created on first use.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def find(self, request: str) -> tuple[KeptAnswer, bytes] | None:
        """Return the cached response of a request; None if missing or damaged.

        Raises:
            InputError: the folder cannot be read.
        """
        record = kept_bytes(self._record(request), _EXPECTED)
        if record is None:
            return None
        try:
            fields = parse_json(record)
            told = KeptAnswer(**fields)
            datetime.fromisoformat(told.at)
        except (NotJsonError, TypeError, ValueError):
            return None
        data = kept_bytes(self._object(str(told.sha256)), _EXPECTED)
        if data is None or hashlib.sha256(data).hexdigest() != told.sha256:
            return None
        return told, data

    def keep(self, request: str, data: bytes, version: str, total: int) -> KeptAnswer:
        """Store a response, and return its record.

        Raises:
            InputError: the folder cannot be written.
        """
        digest = hashlib.sha256(data).hexdigest()
        told = KeptAnswer(digest, now(), version, total)
        keep_bytes(self._object(digest), data, _EXPECTED)
        text = json.dumps(asdict(told), sort_keys=True)
        keep_bytes(self._record(request), text.encode(), _EXPECTED)
        return told

    def forget(self, request: str) -> None:
        """Remove the response of a request."""
        self._record(request).unlink(missing_ok=True)

    def _record(self, request: str) -> Path:
        digest = hashlib.sha256(request.encode()).hexdigest()
        return self.folder / "requests" / digest[:2] / f"{digest}.json"

    def _object(self, digest: str) -> Path:
        return self.folder / "contents" / digest[:2] / digest


def now() -> str:
    """Return the time, UTC, ISO 8601, to the second."""
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
