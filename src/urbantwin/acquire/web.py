"""Asking servers: through the cache, politely, with the key of a source, and offline."""

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

#: Of one answer, of all of a source, and how long a source may take.
LIMITS = Limits(256 << 20, 2 << 30, 1800.0)


class ChangedError(DownloadError):
    """A file is another than the one whose parts came before."""


class NotAcquiredError(Exception):
    """A source does not give what it was asked for; the text is one line, without any key."""


class NoKeyError(NotAcquiredError):
    """A source needs a key, and there is none."""


class NothingThereError(NotAcquiredError):
    """A source has nothing at the place."""

    def __init__(self, problem: str = "has nothing there") -> None:
        super().__init__(problem)


@dataclass(frozen=True)
class Fetched:
    """What was answered.

    Attributes:
        data: the bytes.
        at: when it was answered, UTC, ISO 8601.
        version: of the file, as `download.Answer` has it.
        total: bytes of the whole file.
        whole: whether ``data`` is all of the file though a part was asked for.
    """

    data: bytes
    at: str
    version: str
    total: int
    whole: bool = True


class Web:
    """All servers that acquisition asks.

    Args:
        cache: where answers are kept and looked for.
        offline: whether nobody is asked.
        environment: where keys are; the process's own when not given.
        limits: of size and time, of each source.

    Attributes:
        offline: whether nobody is asked.
        warnings: what is to be told of answers.
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
        """Return a source's key; empty where it needs none.

        Args:
            source: the source.
            address: of a mirror, where the key goes to that.

        Raises:
            NoKeyError: it needs one, and there is none.
            InputError: there is one that the user did not allow to be sent there.
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
        """All keys that were used."""
        return Secrets(sorted(self._keys))

    def server(self, source: SourceSpec, address: str | None = None) -> Server:
        """Return a source's server.

        Args:
            source: the source.
            address: of a mirror.

        Raises:
            NoKeyError: there is none.
            InputError: the user did not allow its key to be sent there.
        """
        return Server(self, source, address or source.address, self.key_of(source, address))

    def wait(self, origin: str, pause_s: float) -> None:
        """Wait until a server may be asked again."""
        with self._lock:
            told = time.monotonic()
            at = max(told, self._asked.get(origin, -1e9) + pause_s)
            self._asked[origin] = at
        time.sleep(at - told)


class Server:
    """One server of a source, with the others that it leads to.

    Args:
        web: of which it is.
        source: whose.
        root: an address of it, which may hold braces.
        key: the source's; empty without one.
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
        """Return an address as people may see it: without its key and what it asks for."""
        return self._client.secrets.hidden(re.sub(r"[?#].*", "", address))

    def hidden(self, text: str) -> str:
        """Return a text without the key."""
        return self._client.secrets.hidden(text)

    def get(self, address: str) -> Fetched:
        """Return what is at an address, which may hold ``{key}``; from the cache if it is there.

        Raises:
            DownloadError: it cannot be had.
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
        """Return a part of a file; from the cache if it is there.

        Args:
            address: the file's; it may hold ``{key}``.
            span: the first byte and the one after the last.
            version: that of the parts before, which it must be of, or ``None`` for the first.

        Raises:
            DownloadError: it cannot be had, or the file is another by now.
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
        """Forget the first part of a file that is another by now."""
        self.web.cache.forget(f"{address} bytes {span[0]}-{span[1]} of None")

    def _ask(self, address: str, span: Span | None) -> Answer:
        if self.web.offline:
            raise DownloadError("is not in the cache, and offline nobody is asked")
        there = address.replace("{key}", quote(self._key, safe=""))
        self.web.wait(str(parse_address(there).origin), self.source.pause_s)
        return self._client.fetch(there, span)

    def _kept(self, request: str, answer: Answer, version: str = "") -> Fetched:
        """Return an answer after keeping it, unless it holds a key."""
        data, total = answer.body, answer.total or len(answer.body)
        if self._client.secrets.held_by(data):
            return Fetched(data, now(), version, total)
        told = self.web.cache.keep(request, data, version, total)
        return Fetched(data, told.at, version, total)


def _of_kept(kept: tuple[KeptAnswer, bytes], *, whole: bool = True) -> Fetched:
    told, data = kept
    return Fetched(data, told.at, told.version, told.total, whole)
