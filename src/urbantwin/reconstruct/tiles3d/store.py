"""Stores of tiles: a folder or an archive, which no path leads out of."""

from __future__ import annotations

import posixpath
import re
import zipfile
import zlib
from pathlib import Path
from typing import Protocol
from urllib.parse import unquote, urlsplit

from urbantwin.errors import InputError
from urbantwin.reconstruct.gltf.untrusted_values import MalformedError

__all__ = ["LARGEST_TILE", "Archive", "Folder", "Store", "local_path", "unzipped"]

#: A tile, unpacked, may have this many bytes.
LARGEST_TILE = 1 << 28


class Store(Protocol):
    """A place that tiles are fetched from.

    Attributes:
        root: the address of the first file.
        parallel: how many fetches at a time are of use.
    """

    root: str
    parallel: int

    def resolve(self, base: str, uri: str) -> str:
        """Return the address that ``uri`` means in the file at ``base``.

        Raises:
            MalformedError: it leads out of the store.
        """

    def fetch(self, address: str) -> bytes:
        """Return the bytes at an address.

        Raises:
            MalformedError: they cannot be had.
        """

    def name(self, address: str) -> str:
        """Return what the file is called in reports; nothing secret is part of it."""

    def hidden(self, text: str) -> str:
        """Return what a report may say of a file's content: nothing secret is part of it."""


def local_path(base: str, uri: str) -> str:
    """Return the path, relative to a store's root, that ``uri`` means in the file at ``base``.

    Percent-encoding is undone once, before anything is judged.

    Raises:
        MalformedError: it has a scheme or a host, is absolute, or climbs out.
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
    """A folder of tiles; links that lead out of it are refused as well."""

    parallel = 1

    def __init__(self, first: Path) -> None:
        self._folder = first.parent.resolve()
        self.root = first.name

    def resolve(self, base: str, uri: str) -> str:
        """Return the path below the folder that ``uri`` means in the file at ``base``."""
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
        """Return the text: nothing is secret here."""
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
        """Return the member that ``uri`` means in the member ``base``."""
        return local_path(base, uri)

    def fetch(self, address: str) -> bytes:
        """Return a member, never more of it than a tile may have."""
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
        """Return the text: nothing is secret here."""
        return text


def unzipped(data: bytes) -> bytes:
    """Return a tile as it was before it was packed with gzip, or unchanged if it was not.

    Raises:
        MalformedError: it cannot be unpacked, or unpacks to more than a tile may have.
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
