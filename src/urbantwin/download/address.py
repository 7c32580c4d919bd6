"""HTTP addresses and their origins, the error of a download, and keys hidden in texts."""

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
    """Something could not be downloaded; the text is one line, and no key is part of it.

    Args:
        problem: what is wrong, after the name of what was asked for: ``not found (404)``.
        status: the server's status, if it answered with one that is not good.
        unanswered: the server could not be reached, or broke off.
        may_pass: the same request may do better a moment later.
        after_s: how long the server asks to wait before it is asked again, seconds.
        spent: what may be downloaded altogether has been: asking for more is of no use.
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
    """Who is asked: two addresses are of one origin only if all three agree (RFC 6454).

    Attributes:
        scheme: ``http`` or ``https``.
        host: lower case, ASCII (international names as in DNS); of IPv6 without brackets.
        port: the scheme's own where the address names none.
    """

    scheme: str
    host: str
    port: int

    def __str__(self) -> str:
        """Return it as it stands in an address."""
        return f"{self.scheme}://{self.netloc}"

    @property
    def netloc(self) -> str:
        """The host, with the port where it is not the scheme's own."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return host if self.port == _PORTS[self.scheme] else f"{host}:{self.port}"


@dataclass(frozen=True)
class Address:
    """A request: nothing of it is parsed again between being judged and being sent.

    Attributes:
        origin: who is asked.
        path: what for, percent-encoded, from the first slash.
        query: what follows the question mark, percent-encoded.
    """

    origin: Origin
    path: str
    query: str

    @property
    def target(self) -> str:
        """What the request asks for (RFC 9112, origin-form)."""
        return f"{self.path}?{self.query}" if self.query else self.path

    def __str__(self) -> str:
        """Return the whole address, without a fragment."""
        return f"{self.origin}{self.target}"


def parse_address(text: str) -> Address:
    """Return an address of HTTP or HTTPS, taken apart.

    Raises:
        DownloadError: it is not such an address, or it holds a name or a password.
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
    """Return an origin that a person wrote: ``https://host`` or ``http://host:8080``.

    Raises:
        DownloadError: it is not an origin, or has more than scheme, host and port.
    """
    if not re.fullmatch(r"[A-Za-z]+://[^/?#@\s]+/?", text):
        raise DownloadError("is not an origin")
    return parse_address(text).origin


#: A secret is looked for inside of texts from so many characters on: of a shorter one everything
#: seems to hold it.
SHORTEST = 4


class Secrets:
    """What must reach neither another origin nor a report.

    Args:
        known: the secrets, as they are.
    """

    def __init__(self, known: Iterable[str]) -> None:
        self._known = tuple(known)
        ways = (str, partial(quote, safe=""), quote, quote_plus)
        written = {way(one) for one in self._known if len(one) >= SHORTEST for way in ways}
        self._written = tuple(sorted(written, key=lambda form: (-len(form), form)))

    def hidden(self, text: str) -> str:
        """Return a text without any of them."""
        for form in self._written:
            text = text.replace(form, "***")
        return text

    def held_by(self, data: bytes) -> bool:
        """Return whether a server wrote one of them into what it answered."""
        return any(form.encode() in data for form in self._written)

    def told_in(self, text: str) -> bool:
        """Return whether a part of an address (``name=value``) holds one, however encoded."""
        forms = {text, text.partition("=")[2]}
        for undo in (unquote, unquote_plus, unquote, unquote_plus):
            forms |= {undo(form) for form in forms}
        lowered = {form.lower() for form in forms}
        for secret in (one.lower() for one in self._known):
            inside = len(secret) >= SHORTEST and any(secret in form for form in lowered)
            if inside or secret in lowered:
                return True
        return False
