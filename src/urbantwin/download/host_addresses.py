"""IP addresses of a host, and whether they are public."""

from __future__ import annotations

import ipaddress
import socket
from typing import Any

__all__ = ["is_public", "literal_address", "located"]

#: What ``socket.getaddrinfo`` says of a way to connect: family, and address of that family.
Place = tuple[int, Any]

_IPv4InIPv6 = {
    # RFC 6052: how a network without IPv4 reaches it.
    "nat64": (ipaddress.IPv6Network("64:ff9b::/96"), 0),
    # RFC 3056.
    "6to4": (ipaddress.IPv6Network("2002::/16"), 80),
}


def is_public(text: str) -> bool:
    """Return whether an address (IPv4 or IPv6, as numbers) belongs to the open internet.

    Not so loopback, private, link-local, shared, multicast, reserved and unspecified ones, by
    IANA's registries of special-purpose addresses (RFC 6890); an IPv6 address that holds one of
    IPv4 is judged by that.
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
    """Return the numbers that a host's spelling alone stands for, or ``None`` for other names.

    As the C library reads them: ``127.1``, ``2130706433`` and ``0x7f000001`` are one; and names
    that are this machine by definition (RFC 6761).
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
    """Return where a host can be reached, in the system's order.

    Raises:
        OSError: its name is not known.
    """
    found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    return [
        (family, place)
        for family, _, _, _, place in found
        if family in (socket.AF_INET, socket.AF_INET6)
    ]
