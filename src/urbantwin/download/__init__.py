"""HTTP downloads: a client restricted to permitted origins, within limits."""

from __future__ import annotations

from urbantwin.download.address import (
    Address,
    DownloadError,
    Origin,
    Secrets,
    parse_address,
    parse_origin,
)
from urbantwin.download.client import Client, Limits
from urbantwin.download.kept_files import keep_bytes, kept_bytes
from urbantwin.download.keys import (
    VARIABLE,
    allowed_keys_file,
    key_for,
    keys_allowed,
    no_keys,
)
from urbantwin.download.response_body import Answer, Span

__all__ = [
    "VARIABLE",
    "Address",
    "Answer",
    "Client",
    "DownloadError",
    "Limits",
    "Origin",
    "Secrets",
    "Span",
    "allowed_keys_file",
    "keep_bytes",
    "kept_bytes",
    "key_for",
    "keys_allowed",
    "no_keys",
    "parse_address",
    "parse_origin",
]
