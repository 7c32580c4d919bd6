"""A file of CityGML, also compressed: its city objects one after the other."""

from __future__ import annotations

import gzip
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, cast

from lxml import etree

from urbantwin.errors import InputError
from urbantwin.strict_xml import child_elements, root_name

__all__ = ["local_name", "members", "opened", "within_archive"]

#: The most that is unpacked and read, bytes (1 GB of CityGML takes minutes, an object at a time).
LARGEST = 2_000_000_000
_EXPECTED = "CityGML"
#: Endings of files of CityGML within an archive.
_ENDINGS = (".gml", ".citygml", ".xml")
#: Elements of the root that hold a city object.
_MEMBERS = ("cityObjectMember", "featureMember")


class _Bounded:
    """A stream of which no more than so much is read."""

    def __init__(self, stream: IO[bytes], path: Path) -> None:
        self._stream, self._path, self._read = stream, path, 0

    def read(self, size: int = -1) -> bytes:
        """Return the next bytes.

        Raises:
            InputError: there are too many, or they cannot be unpacked.
        """
        try:
            data = self._stream.read(min(size, 1 << 20) if size >= 0 else 1 << 20)
        except (OSError, EOFError, zlib.error, zipfile.BadZipFile, RuntimeError) as error:
            problem = f"cannot be unpacked ({error})"
            raise InputError(problem, file=self._path, expected="a whole archive") from None
        self._read += len(data)
        if self._read > LARGEST:
            raise InputError(
                f"holds more than {LARGEST / 1e9:.0f} GB",
                file=self._path,
                expected="CityGML cut to the site",
            )
        return data


def within_archive(path: Path) -> str | None:
    """Return the name of the one file of CityGML in a zip archive; ``None`` if there is not one."""
    try:
        with zipfile.ZipFile(path) as archive:
            names = [
                one.filename
                for one in archive.infolist()
                if one.filename.lower().endswith(_ENDINGS) and "__MACOSX" not in one.filename
            ]
    except (zipfile.BadZipFile, OSError, NotImplementedError, ValueError):
        return None
    return names[0] if len(names) == 1 else None


@contextmanager
def opened(path: Path) -> Iterator[IO[bytes]]:
    """Open a file, or what a gzip file or a zip archive holds of CityGML.

    Raises:
        InputError: it cannot be read, or an archive holds no or several files of CityGML.
    """
    try:
        with path.open("rb") as stream:
            start = stream.read(4)
        if start.startswith(b"\x1f\x8b"):
            with gzip.open(path) as packed:
                yield cast(IO[bytes], _Bounded(cast(IO[bytes], packed), path))
        elif start.startswith(b"PK\x03\x04"):
            name = within_archive(path)
            if name is None:
                raise InputError(
                    "is an archive without one file of CityGML",
                    file=path,
                    expected=f"a zip of one {', '.join(_ENDINGS)}",
                )
            with zipfile.ZipFile(path) as archive, archive.open(name) as packed:
                yield cast(IO[bytes], _Bounded(packed, path))
        else:
            with path.open("rb") as stream:
                yield cast(IO[bytes], _Bounded(stream, path))
    except (OSError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise InputError(f"cannot be read ({error})", file=path) from None
    except (NotImplementedError, RuntimeError) as error:  # a method or a password that zip has
        raise InputError(f"cannot be unpacked ({error})", file=path) from None


def members(path: Path) -> Iterator[etree._Element]:
    """Yield the envelope of the whole (``boundedBy``) and each city object, whole.

    Only one object is kept in memory at a time. Document types are refused, entities are never
    expanded, and nothing is fetched.

    Raises:
        InputError: it is not CityGML, or damaged.
    """
    with opened(path) as stream:
        root = root_name(stream, path, _EXPECTED)
    if root != "CityModel":
        raise InputError(
            f"is not CityGML: its root is <{root[:40]}>", file=path, expected="<CityModel>"
        )
    with opened(path) as stream:
        for item in child_elements(stream, (*_MEMBERS, "boundedBy"), path):
            if local_name(item) == "boundedBy":
                yield item
            else:
                yield from item


def local_name(element: etree._Element) -> str:
    """Return an element's name without its namespace."""
    tag = element.tag
    return tag.rpartition("}")[2] if isinstance(tag, str) else ""
