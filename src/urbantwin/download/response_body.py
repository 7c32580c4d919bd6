"""Body of an HTTP response: complete, decompressed, and within a size limit.

Ranges and validators follow RFC 9110 (sections 8.8, 10.2.3 and 14).
"""

from __future__ import annotations

import email.utils
import http.client
import re
import time
import zlib
from dataclasses import dataclass

from urbantwin.download.address import DownloadError

__all__ = ["Answer", "Span", "read_answer", "read_body", "waits_s"]

#: First byte and end of a range.
Span = tuple[int, int]

_CHUNK = 1 << 18


@dataclass(frozen=True)
class Answer:
    """A response.

    Attributes:
        body: the bytes, decompressed.
        first: position of the first byte in the file; 0 unless a range was returned.
        total: size of the file, bytes; ``None`` for a range of unknown total.
        version: identifies the version of the file: its ETag, or else its modification time.
    """

    body: bytes
    first: int
    total: int | None
    version: str


def read_answer(response: http.client.HTTPResponse, most_bytes: int, span: Span | None) -> Answer:
    """Return a response, limited to the requested range.

    Raises:
        DownloadError: as for `read_body`, or another range was returned.
    """
    version = response.getheader("ETag") or response.getheader("Last-Modified") or ""
    if span is None or response.status != 206:
        body = read_body(response, most_bytes)
        return Answer(body, 0, len(body), version)
    told = re.fullmatch(
        r"bytes ([0-9]{1,18})-([0-9]{1,18})/([0-9]{1,18}|\*)",
        (response.getheader("Content-Range") or "").strip(),
        re.ASCII,
    )
    if told is None or int(told[1]) != span[0]:
        raise DownloadError("is refused: the server sends another range than was requested")
    first, after = int(told[1]), int(told[2]) + 1
    total = None if told[3] == "*" else int(told[3])
    if after != (span[1] if total is None else min(span[1], total)):
        raise DownloadError("ends early", unanswered=True, may_pass=True)
    body = read_body(response, most_bytes)
    if len(body) != after - first:
        raise DownloadError("ends early", unanswered=True, may_pass=True)
    return Answer(body, first, total, version)


def waits_s(response: http.client.HTTPResponse) -> float | None:
    """Return the pause requested by a server (``Retry-After``: seconds or a date), seconds."""
    told = (response.getheader("Retry-After") or "").strip()
    if re.fullmatch(r"[0-9]{1,9}", told, re.ASCII):
        return float(told)
    try:
        return max(0.0, email.utils.parsedate_to_datetime(told).timestamp() - time.time())
    except (TypeError, ValueError, OverflowError):
        return None


def read_body(response: http.client.HTTPResponse, most_bytes: int) -> bytes:
    """Return the decompressed body of a response.

    Args:
        response: the response, headers read.
        most_bytes: largest body, compressed or not.

    Raises:
        DownloadError: the body is too large, shorter than its header states, or compressed in
            another way than requested.
    """
    stated = _stated_length(response)
    if stated is not None and stated > most_bytes:
        raise _too_large(most_bytes)
    packed = (response.getheader("Content-Encoding") or "identity").strip().lower()
    if packed not in ("identity", "gzip", "x-gzip"):
        raise DownloadError("is compressed by the server in a way that was not requested")
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
                if machine.eof:  # several gzip members may follow each other (RFC 1952)
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
    # ``http.client`` does not report a body that ends early.
    cut = stated is not None and received != stated
    if cut or (packed != "identity" and received and not machine.eof):
        raise DownloadError("ends early", unanswered=True, may_pass=True)
    return b"".join(parts)


def _stated_length(response: http.client.HTTPResponse) -> int | None:
    """Return the length stated in the headers, or ``None`` if none is stated.

    Raises:
        DownloadError: the lengths are contradictory or invalid (RFC 9112, section 6.3).
    """
    coding = response.getheader("Transfer-Encoding")
    if coding is not None:
        if coding.strip().lower() != "chunked":
            raise DownloadError("is compressed by the server in a way that was not requested")
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
