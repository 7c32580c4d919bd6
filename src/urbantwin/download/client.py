"""HTTP client restricted to permitted origins; its key is sent to the root's origin only.

Built on ``http.client``, because higher-level clients (urllib, urllib3, requests) resolve a name
again after its addresses were checked, and limit the time of single reads instead of the response.
"""

from __future__ import annotations

import contextlib
import http.client
import socket
import ssl
import string
import threading
import time
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from urllib.parse import quote, urlencode, urljoin

from urbantwin import __version__
from urbantwin.download.address import Address, DownloadError, Origin, Secrets, parse_address
from urbantwin.download.connection import (
    Pace,
    Place,
    is_public,
    literal_address,
    located,
    open_connection,
    proxy_for,
    secure_context,
)
from urbantwin.download.response_body import Answer, Span, read_answer, waits_s

__all__ = ["Client", "Limits"]

TRIES = 4
#: Pause before the second attempt, seconds; each further pause is four times as long.
PAUSE_S = 0.25
#: No further attempt after this time, seconds.
LAST_TRY_S = 30.0
#: Longest ``Retry-After`` that is respected, seconds; longer ones end the attempts.
LONGEST_WAIT_S = 60.0
#: Consecutive requests without a response after which a server is given up.
PATIENCE = 64
MOST_REDIRECTS = 5
#: Common connection errors in words.
_IN_WORDS: Mapping[type[Exception], str] = {
    socket.gaierror: "there is no network, or no host of this name",
    ConnectionRefusedError: "nobody listens there",
    TimeoutError: "no answer in time",
}
_MOVED = (301, 302, 303, 307, 308)


@dataclass(frozen=True)
class Limits:
    """Limits of downloads.

    Attributes:
        one_bytes: size of one response, decompressed, bytes.
        all_bytes: size of all responses together, bytes.
        all_s: total time, seconds.
        think_s: time until a server responds, seconds, if longer than the default.
    """

    one_bytes: int
    all_bytes: int
    all_s: float
    think_s: float = 0.0


class Client:
    """Downloads from an address given by the user and from permitted origins; thread-safe.

    - Requests go to the root's origin and to listed origins; each redirect is a request.
    - The key goes to the root's origin. Addresses in its responses that lead elsewhere are
      requested without the key, or rejected.
    - Private addresses are requested only if the root is private; a host name is judged by the IP
      addresses that are then connected to. Behind a proxy of the environment only the spelling of
      an address can be judged, since the proxy resolves names.
    - Redirects never lead from HTTPS to HTTP.

    Args:
        root: address given by the user.
        limits: limits of size and time.
        origins: further permitted origins.
        key: added to requests as ``key=``, or ``None``.
        bearer: sent as ``Authorization: Bearer``, or ``None``.
        secrets: further texts that must not reach another origin: keys within addresses.

    Attributes:
        root: origin of the root.
        secrets: the key and the other secrets.

    Raises:
        DownloadError: the root is not an HTTP address.
    """

    def __init__(
        self,
        root: str,
        limits: Limits,
        *,
        origins: Iterable[Origin] = (),
        key: str | None = None,
        bearer: str | None = None,
        secrets: Iterable[str] = (),
    ) -> None:
        self.root = parse_address(root).origin
        self._allowed = frozenset({self.root, *origins})
        self._limits = limits
        self._key = key
        self._bearer = bearer
        self.secrets = Secrets(one for one in (key, bearer, *secrets) if one)
        self._lock = threading.Lock()
        self._deciding = threading.Lock()
        self._unanswered: Counter[Origin] = Counter()
        self._received = 0
        self._begun: float | None = None
        self._private: bool | None = None

    def check(self, address: Address, how: str = "it lies at") -> None:
        """Check that an address may be requested, judged by its origin.

        Raises:
            DownloadError: its origin is neither the root's nor listed.
        """
        origin = address.origin
        if origin not in self._allowed:
            name = "another origin" if self.secrets.told_in(str(origin)) else str(origin)
            raise DownloadError(
                f"is refused: {how} {name}, which is not the root's origin nor among its origins"
            )

    def get(self, address: str) -> bytes:
        """Return the content at an address; temporary failures are retried.

        Raises:
            DownloadError: the download failed.
        """
        return self.fetch(address).body

    def fetch(self, address: str, span: Span | None = None) -> Answer:
        """Return the response for an address, with the retries of `get`.

        Args:
            address: address to request.
            span: first byte and end of the range; a server without ranges sends more
                (`Answer.first`).

        Raises:
            DownloadError: the download failed, or the server requests a long pause.
        """
        first = parse_address(address)
        attempt, begun = 0, time.monotonic()
        while True:
            try:
                return self._followed(first, span)
            except DownloadError as error:
                attempt += 1
                late = time.monotonic() - begun > LAST_TRY_S
                told_s = error.after_s or 0.0
                if attempt == TRIES or late or not error.may_pass or told_s > LONGEST_WAIT_S:
                    raise
            time.sleep(max(PAUSE_S * 4 ** (attempt - 1), told_s))

    def _followed(self, here: Address, span: Span | None) -> Answer:
        """Return the response for an address, after redirects."""
        for _ in range(MOST_REDIRECTS + 1):
            self.check(here)
            answer = self._asked(here, span)
            if isinstance(answer, Answer):
                return answer
            here = self._moved(here, answer)
        raise DownloadError(f"is redirected more than {MOST_REDIRECTS} times")

    def _moved(self, here: Address, location: str) -> Address:
        """Return the target of a redirect."""
        try:
            there = parse_address(urljoin(str(here), quote(location, safe=string.punctuation)))
        except (DownloadError, ValueError):
            raise DownloadError("is refused: it redirects to what is no address of HTTP") from None
        if here.origin.scheme == "https" and there.origin.scheme == "http":
            raise DownloadError("is refused: it redirects from https to http")
        self.check(there, "it redirects to")
        return there

    def _asked(self, address: Address, span: Span | None) -> Answer | str:
        """Return one response, or the target of its redirect."""
        self._spend(0)
        origin = address.origin
        if self._unanswered[origin] >= PATIENCE:
            raise DownloadError("is not requested: the server no longer answers")
        try:
            answer = self._answer(self._with_key(address), span)
        except DownloadError as error:
            failure = error
        except (http.client.HTTPException, OSError, ValueError) as error:
            # The error may contain the address with the key: only its type is reported.
            kind = type(error)
            why = f"cannot be fetched ({_IN_WORDS.get(kind, kind.__name__)})"
            failure = DownloadError(why, unanswered=True, may_pass=True)
        else:
            with self._lock:
                self._unanswered[origin] = 0
            self._spend(len(answer.body if isinstance(answer, Answer) else answer))
            return answer
        with self._lock:
            self._unanswered[origin] += 1
            if not failure.unanswered:
                self._unanswered[origin] = 0
        raise failure from None

    def _answer(self, address: Address, span: Span | None) -> Answer | str:
        """Send one request; return a response or the target of a redirect."""
        proxy = proxy_for(address.origin)
        places = self._places(address.origin, looked_up=proxy is None)
        pace = Pace(self._limits.one_bytes, self._limits.think_s)
        context = self._context if address.origin.scheme == "https" else None
        connection, target, headers = open_connection(address, places, pace, context, proxy)
        headers |= {
            "User-Agent": f"urbantwin/{__version__}",
            "Accept-Encoding": "gzip" if span is None else "identity",
            "Connection": "close",
        }
        if span is not None:
            headers["Range"] = f"bytes={span[0]}-{span[1] - 1}"
        if self._bearer is not None and address.origin == self.root:
            headers["Authorization"] = f"Bearer {self._bearer}"
        with contextlib.closing(connection):
            connection.request("GET", target, headers=headers)
            with connection.getresponse() as response:
                location = response.getheader("Location")
                if response.status in _MOVED and location:
                    return location
                if not 200 <= response.status < 300:
                    raise _refusal(response.status, waits_s(response))
                return read_answer(response, self._limits.one_bytes, span)

    @cached_property
    def _context(self) -> ssl.SSLContext:
        return secure_context()

    def _places(self, origin: Origin, *, looked_up: bool) -> list[Place]:
        """Return the places to connect to for an origin; empty if not looked up.

        Raises:
            DownloadError: its addresses are private, and the root's are not.
            OSError: its name cannot be resolved.
        """
        private = self._root_is_private()
        if not looked_up:
            literal = literal_address(origin.host)
            if literal is not None and not private and not is_public(literal):
                raise DownloadError(
                    f"is refused: {origin} is a private address, and the root's is not"
                )
            return []
        places = located(origin.host, origin.port)
        if private:
            return places
        public = [place for place in places if is_public(place[1][0])]
        if not public:
            raise _private(origin)
        return public

    def _root_is_private(self) -> bool:
        """Return whether the root has private addresses, decided on first use.

        The decision is final: a name that was public cannot turn into this machine's.
        """
        with self._deciding:
            if self._private is None:
                found = [literal_address(self.root.host)]
                if found == [None] and proxy_for(self.root) is None:
                    found = [place[0] for _, place in located(self.root.host, self.root.port)]
                self._private = not any(one is None or is_public(one) for one in found)
            return self._private

    def _with_key(self, address: Address) -> Address:
        """Return the address to request: with the key for the root's origin, elsewhere without.

        Raises:
            DownloadError: the address has another origin and contains the key.
        """
        pairs = address.query.split("&") if address.query else []
        if address.origin == self.root:
            if self._key is not None:
                pairs = [pair for pair in pairs if pair.partition("=")[0] != "key"]
                pairs.append(urlencode({"key": self._key}))
        else:
            pairs = [pair for pair in pairs if not self.secrets.told_in(pair)]
        asked = replace(address, query="&".join(pairs))
        if asked.origin != self.root and self.secrets.told_in(str(asked)):
            raise DownloadError("is refused: the key would go to another origin")
        return asked

    def _spend(self, received: int) -> None:
        """Count received bytes.

        Raises:
            DownloadError: the total size or time is exceeded.
        """
        limits = self._limits
        with self._lock:
            self._begun = time.monotonic() if self._begun is None else self._begun
            self._received += received
            if self._received > limits.all_bytes:
                size = f"{limits.all_bytes / (1 << 30):g} GiB"
                raise DownloadError(f"needs more than {size} altogether", spent=True)
            if time.monotonic() - self._begun > limits.all_s:
                raise DownloadError(
                    f"takes longer than {limits.all_s / 60:.0f} minutes altogether", spent=True
                )


def _private(origin: Origin) -> DownloadError:
    return DownloadError(f"is refused: {origin} is a private address, and the root's is not")


def _refusal(status: int, after_s: float | None) -> DownloadError:
    """Return the error for an HTTP status, with the pause requested by the server."""
    if status in (401, 403):
        problem = f"is refused by the server ({status}): is the key right?"
    elif status in (404, 410):
        problem = f"not found ({status})"
    else:
        problem = f"cannot be fetched (the server answers {status})"
    if after_s is not None and after_s > LONGEST_WAIT_S:
        problem += f", and asks to wait {after_s:.0f} s"
    may_pass = status in (408, 425, 429) or status >= 500
    return DownloadError(problem, status=status, may_pass=may_pass, after_s=after_s)
