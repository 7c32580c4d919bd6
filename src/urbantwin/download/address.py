"""HTTP addresses and origins, the error of a download, and hiding of keys in texts."""

from __future__ import annotations

import ipaddress
import re
import string
from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from urllib.parse import quote, quote_plus, unquote, unquote_plus, urlsplit

__all__ = ["Address", "DownloadError", "Origin", "Secrets", "parse_address", "parse_origin"]


class DownloadError(Exception):
    """A failed download; the message is one line without keys.

    Args:
        problem: description, following the name of the requested item: ``not found (404)``.
        status: HTTP status, if it was an error.
        unanswered: whether the server could not be reached or broke off.
        may_pass: whether the same request may succeed later.
        after_s: pause requested by the server, seconds.
        spent: whether the total limit is exhausted, so that further requests are useless.
    """

    def __init__(
        self,
        problem: str,
        *,
        status: int | None = None,
        unanswered: bool = False,
        may_pass: bool = False,
        spent: bool = False,
        after_s: float | None = None,
    ) -> None:
        super().__init__(problem)
        self.status = status
        self.unanswered = unanswered
        self.may_pass = may_pass
        self.spent = spent
        self.after_s = after_s


_PORTS = {"http": 80, "https": 443}


@dataclass(frozen=True)
class Origin:
    """Origin of an address: equal only if all three parts agree (RFC 6454).

    Attributes:
        scheme: ``http`` or ``https``.
        host: lower case, ASCII (international names as in DNS); IPv6 without brackets.
        port: port; the scheme's default if the address has none.
    """

    scheme: str
    host: str
    port: int

    def __str__(self) -> str:
        """Return the origin as text: ``https://host:port``."""
        return f"{self.scheme}://{self.netloc}"

    @property
    def netloc(self) -> str:
        """The host, with the port unless it is the scheme's default."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return host if self.port == _PORTS[self.scheme] else f"{host}:{self.port}"


@dataclass(frozen=True)
class Address:
    """A parsed address; it is not parsed again between check and request.

    Attributes:
        origin: origin of the request.
        path: percent-encoded path, from the first slash.
        query: percent-encoded query, without question mark.
    """

    origin: Origin
    path: str
    query: str

    @property
    def target(self) -> str:
        """Request target (RFC 9112, origin-form)."""
        return f"{self.path}?{self.query}" if self.query else self.path

    def __str__(self) -> str:
        """Return the address as text, without a fragment."""
        return f"{self.origin}{self.target}"


def parse_address(text: str) -> Address:
    """Return a parsed HTTP or HTTPS address.

    Raises:
        DownloadError: not such an address, or with user name or password.
    """
    try:
        parts = urlsplit(text.strip())
        port, host = parts.port, parts.hostname
        if parts.scheme not in _PORTS or not host or port == 0:
            raise ValueError
        if "@" in parts.netloc:
            raise DownloadError("is refused: its address holds a name or a password")
        if ":" in host:
            if "%" in host:
                raise ValueError
            host = ipaddress.IPv6Address(host).compressed
        else:
            host = host.encode("idna").decode("ascii").lower()
            if not re.fullmatch(r"[a-z0-9._-]+", host):
                raise ValueError
        path = quote(parts.path or "/", safe=string.punctuation)
        query = quote(parts.query, safe=string.punctuation)
    except ValueError:  # UnicodeError too
        raise DownloadError("is not an address of HTTP") from None
    return Address(Origin(parts.scheme, host, port or _PORTS[parts.scheme]), path, query)


def parse_origin(text: str) -> Origin:
    """Return the origin in a text: ``https://host`` or ``http://host:8080``.

    Raises:
        DownloadError: not an origin, or more than scheme, host and port.
    """
    if not re.fullmatch(r"[A-Za-z]+://[^/?#@\s]+/?", text):
        raise DownloadError("is not an origin")
    return parse_address(text).origin


#: Shortest secret that is searched for inside of texts, characters; shorter ones would match almost
#: anywhere.
SHORTEST = 4


class Secrets:
    """Texts that must reach neither another origin nor a report.

    Args:
        known: the secrets, in plain form.
    """

    def __init__(self, known: Iterable[str]) -> None:
        self._known = tuple(known)
        ways = (str, partial(quote, safe=""), quote, quote_plus)
        written = {way(one) for one in self._known if len(one) >= SHORTEST for way in ways}
        self._written = tuple(sorted(written, key=lambda form: (-len(form), form)))

    def hidden(self, text: str) -> str:
        """Return a text with all secrets hidden."""
        for form in self._written:
            text = text.replace(form, "***")
        return text

    def held_by(self, data: bytes) -> bool:
        """Return whether a response contains a secret."""
        return any(form.encode() in data for form in self._written)

    def told_in(self, text: str) -> bool:
        """Return whether a part of an address (``name=value``) holds a secret in any encoding."""
        forms = {text, text.partition("=")[2]}
        for undo in (unquote, unquote_plus, unquote, unquote_plus):
            forms |= {undo(form) for form in forms}
        lowered = {form.lower() for form in forms}
        for secret in (one.lower() for one in self._known):
            inside = len(secret) >= SHORTEST and any(secret in form for form in lowered)
            if inside or secret in lowered:
                return True
        return False
