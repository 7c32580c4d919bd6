"""HTTP addresses parsed once: the origin that a request goes to, and its path."""

from __future__ import annotations

import ipaddress
import re
import string
from dataclasses import dataclass
from urllib.parse import quote, urlsplit

from urbantwin.download.failure import DownloadError

__all__ = ["Address", "Origin", "parse_address", "parse_origin"]

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
