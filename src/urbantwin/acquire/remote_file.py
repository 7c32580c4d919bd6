"""A remote file as a readable file object, read in blocks by range requests."""

from __future__ import annotations

import io
from typing import Any

from urbantwin.acquire.web import ChangedError, Server
from urbantwin.download import DownloadError

__all__ = ["RemoteFile"]

#: Bytes of a block, which is requested as a whole and kept; most bytes of one request.
BLOCK, AT_ONCE = 1 << 17, 1 << 24


class RemoteFile(io.RawIOBase):
    """A file at an address.

    After an interruption, blocks that were read before come from the cache.

    Args:
        server: server of the file.
        address: address of the file.

    Attributes:
        size: size, bytes.
        at: time of the response with the first block, UTC, ISO 8601.
        failure: first error, for readers that hide errors.

    Raises:
        DownloadError: the download failed.
    """

    def __init__(self, server: Server, address: str) -> None:
        super().__init__()
        self._server, self._address = server, address
        self._position = 0
        self.failure: DownloadError | None = None
        first = server.get_span(address, (0, BLOCK), None)
        self.size, self.at, self._version = first.total, first.at, first.version
        self._blocks: dict[int, bytes] = {}
        self._put(0, first.data)

    def readable(self) -> bool:
        """Return True."""
        return True

    def seekable(self) -> bool:
        """Return True."""
        return True

    def tell(self) -> int:
        """Return the position, bytes from the beginning."""
        return self._position

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        """Move the position, and return it."""
        base = {io.SEEK_SET: 0, io.SEEK_CUR: self._position, io.SEEK_END: self.size}[whence]
        if base + offset < 0:
            raise ValueError("a negative position")
        self._position = base + offset
        return self._position

    def read(self, size: int | None = -1, /) -> bytes:
        """Return up to ``size`` bytes from the position on; allocates no more than the file has."""
        left = max(0, self.size - self._position)
        buffer = bytearray(left if size is None or size < 0 else min(size, left))
        return bytes(buffer[: self.readinto(buffer)])

    def readinto(self, buffer: Any) -> int:  # noqa: ANN401 - any buffer of bytes
        """Fill a buffer from the position on; return the number of bytes."""
        view = memoryview(buffer).cast("B")
        stop = min(self._position + len(view), self.size)
        if stop <= self._position:
            return 0
        try:
            self._fetch(self._position // BLOCK, (stop - 1) // BLOCK)
        except DownloadError as error:
            self.failure = self.failure or error
            raise
        read = 0
        while self._position < stop:
            block, start = divmod(self._position, BLOCK)
            part = self._blocks[block][start : start + stop - self._position]
            view[read : read + len(part)] = part
            read += len(part)
            self._position += len(part)
        return read

    def _fetch(self, first: int, last: int) -> None:
        """Fetch missing blocks, adjacent ones in one request."""
        missing = [block for block in range(first, last + 1) if block not in self._blocks]
        most = AT_ONCE // BLOCK
        while missing:
            run = 1
            while run < min(len(missing), most) and missing[run] == missing[0] + run:
                run += 1
            start, stop = missing[0] * BLOCK, min((missing[0] + run) * BLOCK, self.size)
            try:
                told = self._server.get_span(self._address, (start, stop), self._version)
            except ChangedError:
                self._server.forget(self._address, (0, BLOCK))
                raise
            if told.whole:
                self._put(0, told.data)
            else:
                self._put(missing[0], told.data)
            if missing[0] not in self._blocks:
                raise DownloadError("ends early")
            missing = [block for block in missing if block not in self._blocks]

    def _put(self, first: int, data: bytes) -> None:
        for number, start in enumerate(range(0, len(data), BLOCK)):
            part = data[start : start + BLOCK]
            whole = min(BLOCK, self.size - (first + number) * BLOCK)
            if len(part) == whole:
                self._blocks[first + number] = part
