"""The body of an HTTP response: complete, decompressed, and within a limit of size."""

from __future__ import annotations

import http.client
import re
import zlib

from urbantwin.download.failure import DownloadError

__all__ = ["read_body"]

_CHUNK = 1 << 18


def read_body(response: http.client.HTTPResponse, most_bytes: int) -> bytes:
    """Return what an answer holds, as it was before it was packed for the way.

    Args:
        response: whose headers are read.
        most_bytes: largest body, packed or not.

    Raises:
        DownloadError: it is larger, shorter than its header says, or packed in a way that was not
            asked for.
    """
    stated = _stated_length(response)
    if stated is not None and stated > most_bytes:
        raise _too_large(most_bytes)
    packed = (response.getheader("Content-Encoding") or "identity").strip().lower()
    if packed not in ("identity", "gzip", "x-gzip"):
        raise DownloadError("is packed by the server in a way that was not asked for")
    parts: list[bytes] = []
    size = received = 0
    machine = zlib.decompressobj(wbits=31)
    while data := response.read(_CHUNK):
        received += len(data)
        if received > most_bytes:
            raise _too_large(most_bytes)
        while data:
            part = data
            if packed != "identity":
                if machine.eof:  # members of gzip may follow each other (RFC 1952)
                    machine = zlib.decompressobj(wbits=31)
                try:
                    part = machine.decompress(data, most_bytes - size + 1)
                except zlib.error:
                    raise DownloadError("cannot be unpacked") from None
            parts.append(part)
            size += len(part)
            if size > most_bytes:
                raise _too_large(most_bytes)
            data = machine.unused_data
    # Of a body that ends before its length ``http.client`` does not complain.
    cut = stated is not None and received != stated
    if cut or (packed != "identity" and received and not machine.eof):
        raise DownloadError("ends early", unanswered=True, may_pass=True)
    return b"".join(parts)


def _stated_length(response: http.client.HTTPResponse) -> int | None:
    """Return the length that the headers state, or ``None`` where the body's end shows it.

    Raises:
        DownloadError: they contradict each other or are no length (RFC 9112, section 6.3).
    """
    coding = response.getheader("Transfer-Encoding")
    if coding is not None:
        if coding.strip().lower() != "chunked":
            raise DownloadError("is packed by the server in a way that was not asked for")
        return None
    stated = set(response.headers.get_all("Content-Length") or [])
    if not stated:
        return None
    text = stated.pop().strip()
    if stated or not re.fullmatch(r"[0-9]{1,18}", text, re.ASCII):
        raise DownloadError("is refused: its Content-Length is no length")
    return int(text)


def _too_large(most_bytes: int) -> DownloadError:
    if most_bytes % (1 << 20) == 0:
        return DownloadError(f"is larger than {most_bytes >> 20} MiB")
    return DownloadError(f"is larger than {most_bytes / 1e6:g} MB")
