"""Stores of tiles, a folder or an archive, which no path can leave; and access to their files."""

from __future__ import annotations

import hashlib
import posixpath
import re
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Protocol
from urllib.parse import unquote, urlsplit

from urbantwin.errors import InputError
from urbantwin.io.values import MalformedError

__all__ = ["LARGEST_TILE", "Archive", "Folder", "Store", "TileFiles"]

#: Maximum decompressed size of a tile, bytes.
LARGEST_TILE = 1 << 28


class Store(Protocol):
    """A source of files.

    Attributes:
        root: the address of the first file.
        parallel: number of simultaneous fetches.
    """

    root: str
    parallel: int

    def resolve(self, base: str, uri: str) -> str:
        """Return the address of ``uri`` relative to the file at ``base``.

        Raises:
            MalformedError: it leads out of the store.
        """

    def fetch(self, address: str) -> bytes:
        """Return the bytes at an address.

        Raises:
            MalformedError: they cannot be read.
        """

    def name(self, address: str) -> str:
        """Return the name of a file for reports, without secrets."""

    def hidden(self, text: str) -> str:
        """Return a text from a file for reports, without secrets."""


def local_path(base: str, uri: str) -> str:
    """Return the path, relative to a store's root, of ``uri`` relative to the file at ``base``.

    Percent-encoding is decoded once, before any check.

    Raises:
        MalformedError: it has a scheme or a host, is absolute, or leads out.
    """
    try:
        parts = urlsplit(uri.strip())
    except ValueError:
        raise MalformedError("is not an address") from None
    if parts.scheme or parts.netloc:
        raise MalformedError("is refused: it leads away from the tileset's folder")
    path = unquote(parts.path)
    if not path or "\0" in path:
        raise MalformedError("is not an address")
    if path.startswith("/") or "\\" in path or re.match(r"[A-Za-z]:", path):
        raise MalformedError("is refused: it leads out of the tileset's folder")
    joined = posixpath.normpath(posixpath.join(posixpath.dirname(base), path))
    if joined.startswith(("../", "/")) or joined in ("..", "."):
        raise MalformedError("is refused: it leads out of the tileset's folder")
    return joined


class Folder:
    """A folder of tiles; links that lead out of it are rejected, too."""

    parallel = 1

    def __init__(self, first: Path) -> None:
        self._folder = first.parent.resolve()
        self.root = first.name

    def resolve(self, base: str, uri: str) -> str:
        """Return the path in the folder of ``uri`` relative to the file at ``base``."""
        return local_path(base, uri)

    def fetch(self, address: str) -> bytes:
        """Return the bytes of a file of the folder."""
        path = (self._folder / address).resolve()
        if not path.is_relative_to(self._folder):
            raise MalformedError("is refused: it leads out of the tileset's folder")
        try:
            if path.stat().st_size > LARGEST_TILE:
                raise MalformedError(f"is larger than {LARGEST_TILE >> 20} MiB")
            return path.read_bytes()
        except FileNotFoundError:
            raise MalformedError("not found") from None
        except (OSError, ValueError) as error:
            why = getattr(error, "strerror", None) or "not a file"
            raise MalformedError(f"cannot be read ({why})") from None

    def name(self, address: str) -> str:
        """Return the address."""
        return address

    def hidden(self, text: str) -> str:
        """Return the text unchanged: there are no secrets."""
        return text


class Archive:
    """A tileset in one ZIP file (``.3tz``), its ``tileset.json`` at the top."""

    parallel = 1

    def __init__(self, path: Path) -> None:
        try:
            self._zip = zipfile.ZipFile(path)
        except (zipfile.BadZipFile, OSError, ValueError):
            raise InputError("is not a ZIP file", file=path, expected="a .3tz") from None
        self.root = "tileset.json"

    def resolve(self, base: str, uri: str) -> str:
        """Return the member of ``uri`` relative to the member ``base``."""
        return local_path(base, uri)

    def fetch(self, address: str) -> bytes:
        """Return a member, at most the size limit of a tile."""
        try:
            with self._zip.open(address) as member:
                data = member.read(LARGEST_TILE + 1)
        except KeyError:
            raise MalformedError("not found") from None
        except (zipfile.BadZipFile, zlib.error, OSError, EOFError, RuntimeError):
            raise MalformedError("cannot be unpacked") from None
        if len(data) > LARGEST_TILE:
            raise MalformedError(f"is larger than {LARGEST_TILE >> 20} MiB")
        return data

    def name(self, address: str) -> str:
        """Return the address."""
        return address

    def hidden(self, text: str) -> str:
        """Return the text unchanged: there are no secrets."""
        return text


def unzipped(data: bytes) -> bytes:
    """Return a tile decompressed by gzip, or unchanged if it is not compressed.

    Raises:
        MalformedError: it cannot be decompressed, or exceeds the size limit of a tile.
    """
    if data[:2] != b"\x1f\x8b":
        return data
    machine = zlib.decompressobj(wbits=31)
    try:
        result = machine.decompress(data, LARGEST_TILE + 1)
    except zlib.error:
        raise MalformedError("cannot be unpacked") from None
    if len(result) > LARGEST_TILE:
        raise MalformedError(f"unpacks to more than {LARGEST_TILE >> 20} MiB")
    if not machine.eof:
        raise MalformedError("ends early")
    return result


#: Maximum number of bytes and files that a source may fetch.
_MOST_BYTES = 8 << 30
_MOST_FILES = 100_000


class TileFiles:
    """Fetches files of a store.

    Attributes:
        digests: name and SHA-256 of every file that was read, as stored.
    """

    def __init__(self, store: Store) -> None:
        self._store = store
        self._bytes = 0
        self.digests: dict[str, str] = {}

    @property
    def root(self) -> str:
        """The name of the first file for reports."""
        return self._store.name(self._store.root)

    def name(self, address: str) -> str:
        """Return the name of a file for reports."""
        return self._store.name(address)

    def hidden(self, text: str) -> str:
        """Return a text from a file for reports, without secrets."""
        return self._store.hidden(text)

    def resolve(self, base: str, uri: str) -> str:
        """Return the address of ``uri`` relative to the file at ``base``."""
        return self._store.resolve(base, uri)

    def read(self, address: str) -> bytes:
        """Return a decompressed file.

        Raises:
            MalformedError: it cannot be read.
            InputError: the source exceeds the limits.
        """
        return self._taken(address, self._store.fetch(address))

    def read_all(self, addresses: Sequence[str]) -> Iterator[bytes | MalformedError]:
        """Yield files in the requested order, or the error of an unreadable one."""
        with ThreadPoolExecutor(self._store.parallel) as pool:
            # the queue is slightly longer than the number of fetches, to limit memory
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
