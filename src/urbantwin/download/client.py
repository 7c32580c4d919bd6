"""The HTTP client: it asks the root's origin and listed ones, and sends its key to the root's.

Written on ``http.client`` because a client above it (urllib, urllib3, requests) looks a name up
again after we have judged its numbers, and times each read instead of the whole answer.
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
#: Before the second try, seconds; each further pause is four times as long.
PAUSE_S = 0.25
#: Nothing is tried again later than this, seconds.
LAST_TRY_S = 30.0
#: A server that asks for a longer pause (``Retry-After``) is not asked again, seconds.
LONGEST_WAIT_S = 60.0
#: Tries in a row without any answer after which a server is given up.
PATIENCE = 64
MOST_REDIRECTS = 5
#: What the usual failures of a connection mean, in words.
_IN_WORDS: Mapping[type[Exception], str] = {
    socket.gaierror: "there is no network, or no host of this name",
    ConnectionRefusedError: "nobody listens there",
    TimeoutError: "no answer in time",
}
_MOVED = (301, 302, 303, 307, 308)


@dataclass(frozen=True)
class Limits:
    """What may be downloaded.

    Attributes:
        one_bytes: of one answer, unpacked.
        all_bytes: of all answers together.
        all_s: how long all of it may take.
        think_s: how long a server may think before it answers, where that is longer than usual.
    """

    one_bytes: int
    all_bytes: int
    all_s: float
    think_s: float = 0.0


class Client:
    """Downloads what a person named, from where they named it; several threads may use it.

    - The root's origin is asked, and such other ones as are listed; a redirect is a request.
    - The key goes to the root's origin. What an answer of it tells us to ask elsewhere is asked
      without the key, or not at all.
    - Private addresses are asked only if the root is one: where a name leads is judged by the
      numbers that are then connected to. Behind a proxy of the environment only the spelling of
      an address can be judged, since the proxy looks names up.
    - From HTTPS no redirect leads to HTTP.

    Args:
        root: the address that the person named.
        limits: of size and time.
        origins: other origins that may be asked.
        key: added to requests as ``key=``, or ``None``.
        bearer: sent as ``Authorization: Bearer``, or ``None``.
        secrets: what else must not reach another origin: a key that is part of addresses.

    Attributes:
        root: the origin of the root.
        secrets: the key and what else is secret.

    Raises:
        DownloadError: the root is not an address of HTTP.
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
        """Check that an address may be asked for, as far as it alone shows.

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
        """Return what is at an address; failures that may pass are tried again.

        Raises:
            DownloadError: it cannot be had.
        """
        return self.fetch(address).body

    def fetch(self, address: str, span: Span | None = None) -> Answer:
        """Return what is at an address with what the server says of it, as `get` does.

        Args:
            address: what is asked for.
            span: the first byte and the one after the last, of which a server that knows no
                ranges sends more (`Answer.first`).

        Raises:
            DownloadError: it cannot be had, or the server asks to wait for long.
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
        """Return what is at an address, or where redirects from it lead."""
        for _ in range(MOST_REDIRECTS + 1):
            self.check(here)
            answer = self._asked(here, span)
            if isinstance(answer, Answer):
                return answer
            here = self._moved(here, answer)
        raise DownloadError(f"is redirected more than {MOST_REDIRECTS} times")

    def _moved(self, here: Address, location: str) -> Address:
        """Return where a redirect leads."""
        try:
            there = parse_address(urljoin(str(here), quote(location, safe=string.punctuation)))
        except (DownloadError, ValueError):
            raise DownloadError("is refused: it redirects to what is no address of HTTP") from None
        if here.origin.scheme == "https" and there.origin.scheme == "http":
            raise DownloadError("is refused: it redirects from https to http")
        self.check(there, "it redirects to")
        return there

    def _asked(self, address: Address, span: Span | None) -> Answer | str:
        """Return the body of one answer, or the location that it redirects to."""
        self._spend(0)
        origin = address.origin
        if self._unanswered[origin] >= PATIENCE:
            raise DownloadError("is not asked for: the server has stopped to answer")
        try:
            answer = self._answer(self._with_key(address), span)
        except DownloadError as error:
            failure = error
        except (http.client.HTTPException, OSError, ValueError) as error:
            # What went wrong may name the address, and the key with it: only its kind is reported.
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
        """Ask once, and return an answer or a location."""
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
        """Return where an origin may be connected to; nothing where it is not looked up.

        Raises:
            DownloadError: its addresses are private, and the root's are not.
            OSError: its name is not known.
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
        """Return whether the root leads to private addresses, decided when first asked.

        Once decided it stays: a name that was public does not become this machine's.
        """
        with self._deciding:
            if self._private is None:
                found = [literal_address(self.root.host)]
                if found == [None] and proxy_for(self.root) is None:
                    found = [place[0] for _, place in located(self.root.host, self.root.port)]
                self._private = not any(one is None or is_public(one) for one in found)
            return self._private

    def _with_key(self, address: Address) -> Address:
        """Return what is asked for in fact: with the key of the root's origin, elsewhere without.

        Raises:
            DownloadError: the address is of another origin, and made with the key.
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
        """Count what came.

        Raises:
            DownloadError: all that may come has come, or all time is over.
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
    """Return what a status of HTTP means here, and when the server wants to be asked again."""
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
