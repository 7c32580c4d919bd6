"""Downloads over HTTP: one client, which asks only permitted origins, within limits."""

from __future__ import annotations

from urbantwin.download.client import Client, Limits
from urbantwin.download.failure import DownloadError
from urbantwin.download.origin import Address, Origin, parse_address, parse_origin

__all__ = [
    "Address",
    "Client",
    "DownloadError",
    "Limits",
    "Origin",
    "parse_address",
    "parse_origin",
]
