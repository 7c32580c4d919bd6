"""Connections to checked addresses: public networks only, with time limits."""

from __future__ import annotations

import base64
import http.client
import ipaddress
import socket
import ssl
import time
import urllib.request
from dataclasses import dataclass
from typing import Any
from urllib.parse import unquote, urlsplit

from urbantwin.download.address import Address, DownloadError, Origin

__all__ = [
    "Pace",
    "Proxy",
    "is_public",
    "literal_address",
    "located",
    "open_connection",
    "proxy_for",
    "secure_context",
]

#: Result of ``socket.getaddrinfo`` for a connection: family, and address of that family.
Place = tuple[int, Any]

_IPv4InIPv6 = {
    # RFC 6052: IPv4 from networks without it.
    "nat64": (ipaddress.IPv6Network("64:ff9b::/96"), 0),
    # RFC 3056.
    "6to4": (ipaddress.IPv6Network("2002::/16"), 80),
}


def is_public(text: str) -> bool:
    """Return whether an IP address (IPv4 or IPv6) belongs to the public internet.

    False for loopback, private, link-local, shared, multicast, reserved and unspecified addresses,
    by IANA's registries of special-purpose addresses (RFC 6890). An IPv6 address that embeds an
    IPv4 address is judged by the latter.
    """
    address = ipaddress.ip_address(text.partition("%")[0])
    if isinstance(address, ipaddress.IPv6Address):
        if address.ipv4_mapped is not None:
            return is_public(str(address.ipv4_mapped))
        for network, shift in _IPv4InIPv6.values():
            if address in network:
                inner = int(address) >> shift & 0xFFFFFFFF
                return is_public(str(ipaddress.IPv4Address(inner)))
        if address.teredo is not None or address.is_site_local:
            return False
    return address.is_global and not (
        address.is_multicast
        or address.is_reserved
        or address.is_unspecified
        or address.is_loopback
        or address.is_link_local
        or address.is_private
    )


def literal_address(host: str) -> str | None:
    """Return the IP address that a host name spells out, or ``None`` for other names.

    Uses the C library's rules: ``127.1``, ``2130706433`` and ``0x7f000001`` are the same. Also
    covers names of this machine by definition (RFC 6761).
    """
    if ":" in host:
        return host
    name = host.rstrip(".")
    if name == "localhost" or name.endswith(".localhost"):
        return "127.0.0.1"
    try:
        return socket.inet_ntoa(socket.inet_aton(name))
    except OSError:
        return None


def located(host: str, port: int) -> list[Place]:
    """Return the places to connect to for a host, in the system's order.

    Raises:
        OSError: the name cannot be resolved.
    """
    found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    return [
        (family, place)
        for family, _, _, _, place in found
        if family in (socket.AF_INET, socket.AF_INET6)
    ]


#: Time limits for connecting, and for the next byte, seconds.
CONNECT_S, QUIET_S = 10.0, 20.0
#: Time limits of a response: grace period (s), then a lowest mean rate (bytes/s), and a total (s).
GRACE_S, SLOWEST, DEADLINE_S = 30.0, 4096, 300.0


class Pace:
    """Time and size limits of one response, headers included.

    A server that sends single bytes slowly never hits a read timeout, so the whole response is
    limited.

    Args:
        most_bytes: largest body, bytes; 1 MiB and the same amount again are allowed for headers and
            chunk lengths.
        think_s: time limit for the first byte, if longer than the default, seconds.
    """

    def __init__(self, most_bytes: int, think_s: float = 0.0) -> None:
        self._most = 2 * most_bytes + (1 << 20)
        self._think_s = think_s
        self._start = time.monotonic()
        self._received = 0

    def wait_s(self) -> float:
        """Return the time limit for the next byte, seconds.

        Raises:
            DownloadError: the time is over.
        """
        allowed = min(GRACE_S + self._received / SLOWEST, DEADLINE_S)
        quiet_s = QUIET_S
        if not self._received:
            allowed, quiet_s = max(allowed, self._think_s), max(quiet_s, self._think_s)
        left = self._start + allowed - time.monotonic()
        if left <= 0:
            raise DownloadError("cannot be fetched: it comes too slowly", unanswered=True)
        return min(left, quiet_s)

    def count(self, received: int) -> None:
        """Count received bytes."""
        if self._think_s and not self._received:
            self._start = time.monotonic()
        self._received += received
        if self._received > self._most:
            raise DownloadError("is refused: the server sends more than was requested")


class _Plain(socket.socket):
    """A socket with a limited pace."""

    pace: Pace

    def recv_into(self, buffer: Any, *how: Any, **more: Any) -> int:  # noqa: ANN401
        self.settimeout(self.pace.wait_s())
        try:
            received = super().recv_into(buffer, *how, **more)
        except TimeoutError:
            self.pace.wait_s()  # raises if the whole response is late
            raise
        self.pace.count(received)
        return received


class _Encrypted(_Plain, ssl.SSLSocket):
    """A TLS socket with a limited pace."""


def secure_context() -> ssl.SSLContext:
    """Return a TLS context that checks certificates against the system's."""
    context = ssl.create_default_context()
    context.sslsocket_class = _Encrypted
    return context


@dataclass(frozen=True)
class Proxy:
    """An HTTP proxy.

    Attributes:
        host: host of the proxy.
        port: port of the proxy.
        headers: credentials for the proxy.
    """

    host: str
    port: int
    headers: dict[str, str]


def proxy_for(origin: Origin) -> Proxy | None:
    """Return the proxy that the environment names for an origin.

    Requests to this machine never use a proxy.

    Raises:
        DownloadError: the environment names something else than an HTTP proxy.
    """
    named = urllib.request.getproxies().get(origin.scheme)
    if not named or urllib.request.proxy_bypass(origin.netloc):
        return None
    literal = literal_address(origin.host)
    if literal is not None and (literal.startswith("127.") or literal == "::1"):
        return None
    try:
        parts = urlsplit(named if "://" in named else f"http://{named}")
        host, port = parts.hostname, parts.port or 80
    except ValueError:
        host, port, parts = None, 0, urlsplit("")
    if parts.scheme != "http" or not host:
        raise DownloadError(f"is not requested: {origin.scheme}_proxy names no proxy of HTTP")
    headers = {}
    if parts.username is not None:
        who = f"{unquote(parts.username)}:{unquote(parts.password or '')}".encode()
        headers["Proxy-Authorization"] = f"Basic {base64.b64encode(who).decode()}"
    return Proxy(host, port, headers)


def open_connection(
    address: Address,
    places: list[Place],
    pace: Pace,
    context: ssl.SSLContext | None,
    proxy: Proxy | None,
) -> tuple[http.client.HTTPConnection, str, dict[str, str]]:
    """Connect to one of the given places, or through a proxy.

    Args:
        address: address to request.
        places: places of its origin; names are not resolved again, so a changed name leads nowhere
            else.
        pace: limits from now on.
        context: TLS context (`secure_context`), or ``None`` for plain HTTP.
        proxy: proxy to connect through, if any.

    Returns:
        The connection, the request target, and required headers.

    Raises:
        OSError: no connection.
    """
    origin = address.origin
    if context is not None:
        if proxy is None:
            return _encrypted(origin, places, pace, context), address.target, {}
        tunnel = http.client.HTTPSConnection(
            proxy.host, proxy.port, timeout=CONNECT_S, context=context
        )
        tunnel.set_tunnel(origin.host, origin.port, proxy.headers)
        tunnel.connect()
        assert isinstance(tunnel.sock, _Encrypted)
        tunnel.sock.pace = pace
        return tunnel, address.target, {}
    plain = http.client.HTTPConnection(origin.host, origin.port)
    if proxy is None:
        plain.sock = _connected(places, pace)
        return plain, address.target, {}
    plain.sock = _connected(located(proxy.host, proxy.port), pace)
    return plain, str(address), proxy.headers


def _encrypted(
    origin: Origin, places: list[Place], pace: Pace, context: ssl.SSLContext
) -> http.client.HTTPConnection:
    secure = http.client.HTTPSConnection(origin.host, origin.port, context=context)
    wrapped = context.wrap_socket(
        _connected(places, pace), server_hostname=origin.host.removesuffix(".")
    )
    assert isinstance(wrapped, _Encrypted)
    wrapped.pace = pace
    secure.sock = wrapped
    return secure


def _connected(places: list[Place], pace: Pace) -> _Plain:
    """Return a socket to the first place that responds."""
    failure: OSError = ConnectionError("no address")
    for family, place in places:
        wait_s = min(CONNECT_S, pace.wait_s())
        one = _Plain(family, socket.SOCK_STREAM)
        one.pace = pace
        try:
            one.settimeout(wait_s)
            one.connect(place)
            one.settimeout(QUIET_S)
        except OSError as error:
            one.close()
            failure = error
        else:
            return one
    raise failure
