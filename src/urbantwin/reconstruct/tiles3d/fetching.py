"""Fetching the files of a tileset: several at a time, counted, with their checksums."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor

from urbantwin.errors import InputError
from urbantwin.reconstruct.gltf.untrusted_values import MalformedError
from urbantwin.reconstruct.tiles3d.store import Store, unzipped

__all__ = ["TileFiles"]

#: Everything that one source may fetch, bytes.
_MOST_BYTES = 8 << 30
_MOST_FILES = 100_000


class TileFiles:
    """Fetches files of a store.

    Attributes:
        digests: name and SHA-256 of every file that was read, as it was stored.
    """

    def __init__(self, store: Store) -> None:
        self._store = store
        self._bytes = 0
        self.digests: dict[str, str] = {}

    @property
    def root(self) -> str:
        """What the first file is called in reports."""
        return self._store.name(self._store.root)

    def name(self, address: str) -> str:
        """Return what a file is called in reports."""
        return self._store.name(address)

    def hidden(self, text: str) -> str:
        """Return what a report may say of a file's content."""
        return self._store.hidden(text)

    def resolve(self, base: str, uri: str) -> str:
        """Return the address that ``uri`` means in the file at ``base``."""
        return self._store.resolve(base, uri)

    def read(self, address: str) -> bytes:
        """Return a file, unpacked.

        Raises:
            MalformedError: it cannot be had.
            InputError: the source is larger than any site.
        """
        return self._taken(address, self._store.fetch(address))

    def read_all(self, addresses: Sequence[str]) -> Iterator[bytes | MalformedError]:
        """Yield files in the order asked for; one that cannot be had as its error."""
        with ThreadPoolExecutor(self._store.parallel) as pool:
            # A few more than are being fetched may wait, so that memory stays bounded.
            ahead = 1 if self._store.parallel == 1 else 2 * self._store.parallel
            waiting = [pool.submit(self._fetched, a) for a in addresses[:ahead]]
            try:
                for number, address in enumerate(addresses):
                    fetched = waiting.pop(0).result()
                    if number + ahead < len(addresses):
                        waiting.append(pool.submit(self._fetched, addresses[number + ahead]))
                    if isinstance(fetched, MalformedError):
                        yield fetched
                        continue
                    try:
                        yield self._taken(address, fetched)
                    except MalformedError as error:
                        yield error
            finally:
                for future in waiting:
                    future.cancel()

    def _fetched(self, address: str) -> bytes | MalformedError:
        try:
            return self._store.fetch(address)
        except MalformedError as error:
            return error

    def _taken(self, address: str, data: bytes) -> bytes:
        self.digests[self._store.name(address)] = hashlib.sha256(data).hexdigest()
        self._bytes += len(data)
        if self._bytes > _MOST_BYTES or len(self.digests) > _MOST_FILES:
            raise InputError(
                f"needs more than {_MOST_FILES} files or {_MOST_BYTES >> 30} GiB of tiles",
                file=self._store.name(self._store.root),
                expected="a larger geometric_error_m, or a smaller region",
            )
        return unzipped(data)
