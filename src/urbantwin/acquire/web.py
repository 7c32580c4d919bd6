"""Requests to servers: cached, rate-limited, with the key of a source, or offline."""

from __future__ import annotations

import os
import re
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from urllib.parse import quote

from urbantwin.acquire.answer_cache import AnswerCache, KeptAnswer, now
from urbantwin.acquire.source_table import SourceSpec
from urbantwin.download import (
    Answer,
    Client,
    DownloadError,
    Limits,
    Secrets,
    Span,
    key_for,
    parse_address,
    parse_origin,
)
from urbantwin.result_warning import ResultWarning

__all__ = [
    "ChangedError",
    "Fetched",
    "NoKeyError",
    "NotAcquiredError",
    "NothingThereError",
    "Server",
    "Web",
]

#: Limits per source: bytes of one response, bytes of all, and seconds in total.
LIMITS = Limits(256 << 20, 2 << 30, 1800.0)


class ChangedError(DownloadError):
    """A file has changed since its earlier parts were read."""


class NotAcquiredError(Exception):
    """A source does not provide the requested data; the message is one line without keys."""


class NoKeyError(NotAcquiredError):
    """A source needs a key that is not set."""


class NothingThereError(NotAcquiredError):
    """A source has no data at the place."""

    def __init__(self, problem: str = "has nothing there") -> None:
        super().__init__(problem)


@dataclass(frozen=True)
class Fetched:
    """A response, or a cached one.

    Attributes:
        data: the bytes.
        at: time of the response, UTC, ISO 8601.
        version: version of the file, see `download.Answer`.
        total: size of the whole file, bytes.
        whole: whether ``data`` is the whole file although a part was requested.
    """

    data: bytes
    at: str
    version: str
    total: int
    whole: bool = True


class Web:
    """Access to all servers of the acquisition.

    Args:
        cache: cache of responses.
        offline: whether requests are forbidden.
        environment: environment variables with keys; the process's own if not given.
        limits: limits of size and time, per source.

    Attributes:
        offline: whether requests are forbidden.
        warnings: warnings about responses.
    """

    def __init__(
        self,
        cache: AnswerCache,
        *,
        offline: bool = False,
        environment: Mapping[str, str] | None = None,
        limits: Limits = LIMITS,
    ) -> None:
        self.cache = cache
        self.offline = offline
        self.environment = os.environ if environment is None else environment
        self.limits = limits
        self.warnings: list[ResultWarning] = []
        self._keys: set[str] = set()
        self._asked: dict[str, float] = {}
        self._lock = threading.Lock()

    def key_of(self, source: SourceSpec, address: str | None = None) -> str:
        """Return a source's key; empty if it needs none.

        Args:
            source: the source.
            address: address of a mirror, if the key is sent there.

        Raises:
            NoKeyError: the key is not set.
            InputError: the user did not allow sending the key there.
        """
        if source.key_env is None:
            return ""
        value = ""
        if source.key_env in self.environment:
            place = f"the source {source.name}"
            where = address or source.address
            value = key_for(source.key_env, where, self.environment, place=place)
        if not value:
            raise NoKeyError(f"needs a key in the environment variable {source.key_env}")
        self._keys.add(value)
        return value

    @property
    def secrets(self) -> Secrets:
        """All keys used so far."""
        return Secrets(sorted(self._keys))

    def server(self, source: SourceSpec, address: str | None = None) -> Server:
        """Return a source's server.

        Args:
            source: the source.
            address: address of a mirror.

        Raises:
            NoKeyError: the key is not set.
            InputError: the user did not allow sending its key there.
        """
        return Server(self, source, address or source.address, self.key_of(source, address))

    def wait(self, origin: str, pause_s: float) -> None:
        """Wait for the pause between two requests to a server."""
        with self._lock:
            told = time.monotonic()
            at = max(told, self._asked.get(origin, -1e9) + pause_s)
            self._asked[origin] = at
        time.sleep(at - told)


class Server:
    """A server of a source, with the other servers that it refers to.

    Args:
        web: access to servers.
        source: the source.
        root: address of the server, which may hold placeholders.
        key: key of the source; empty without one.
    """

    def __init__(self, web: Web, source: SourceSpec, root: str, key: str) -> None:
        self.web = web
        self.source = source
        inside = "{key}" in root
        self._key = key
        self._client = Client(
            re.sub(r"\{[^}]*\}", "0", root),
            replace(web.limits, think_s=source.think_s),
            origins=[parse_origin(text) for text in source.origins],
            key=None if inside or not key else key,
            secrets=[key] if inside and key else [],
        )

    def shown(self, address: str) -> str:
        """Return an address for display, without its key and query."""
        return self._client.secrets.hidden(re.sub(r"[?#].*", "", address))

    def hidden(self, text: str) -> str:
        """Return a text without the key."""
        return self._client.secrets.hidden(text)

    def get(self, address: str) -> Fetched:
        """Return the content at an address, which may hold ``{key}``; from the cache if present.

        Raises:
            DownloadError: the download failed.
        """
        kept = self.web.cache.find(address)
        if kept is not None and (self.web.offline or kept[0].is_fresh(self.source.fresh_days)):
            return _of_kept(kept)
        try:
            answer = self._ask(address, None)
        except DownloadError as error:
            if kept is None or error.status in (401, 403, 404, 410):
                raise
            self.web.warnings.append(
                ResultWarning(
                    self.source.name, f"the answer of {kept[0].at} is used", self.hidden(str(error))
                )
            )
            return _of_kept(kept)
        return self._kept(address, answer)

    def get_span(self, address: str, span: Span, version: str | None) -> Fetched:
        """Return a part of a file; from the cache if present.

        Args:
            address: the file's address; it may hold ``{key}``.
            span: first byte and end of the part.
            version: required version, that of earlier parts; ``None`` for the first part.

        Raises:
            DownloadError: the download failed, or the file has changed.
        """
        request = f"{address} bytes {span[0]}-{span[1]} of {version}"
        kept = self.web.cache.find(request)
        if kept is not None and (
            version is not None or self.web.offline or kept[0].is_fresh(self.source.fresh_days)
        ):
            return _of_kept(kept, whole=kept[0].total == len(kept[1]))
        answer = self._ask(address, span)
        total = answer.total
        if total is None:
            raise DownloadError("is refused: the server does not say how large the file is")
        its = answer.version or f"{total} bytes"
        if version is not None and its != version:
            raise ChangedError("has changed while it was read")
        if answer.first == span[0] and len(answer.body) <= span[1] - span[0]:
            told = self._kept(request, answer, its)
            return Fetched(told.data, told.at, its, total, total == len(answer.body))
        return Fetched(answer.body, now(), its, total)

    def forget(self, address: str, span: Span) -> None:
        """Remove the first part of a changed file from the cache."""
        self.web.cache.forget(f"{address} bytes {span[0]}-{span[1]} of None")

    def _ask(self, address: str, span: Span | None) -> Answer:
        if self.web.offline:
            raise DownloadError("is not in the cache, and --offline forbids to fetch it")
        there = address.replace("{key}", quote(self._key, safe=""))
        self.web.wait(str(parse_address(there).origin), self.source.pause_s)
        return self._client.fetch(there, span)

    def _kept(self, request: str, answer: Answer, version: str = "") -> Fetched:
        """Return a response after caching it, unless it holds a key."""
        data, total = answer.body, answer.total or len(answer.body)
        if self._client.secrets.held_by(data):
            return Fetched(data, now(), version, total)
        told = self.web.cache.keep(request, data, version, total)
        return Fetched(data, told.at, version, total)


def _of_kept(kept: tuple[KeptAnswer, bytes], *, whole: bool = True) -> Fetched:
    told, data = kept
    return Fetched(data, told.at, told.version, told.total, whole)
