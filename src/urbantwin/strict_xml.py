"""XML of strangers: no document type, and with it no entity, is read before it is looked at."""

from __future__ import annotations

from pathlib import Path
from typing import IO
from xml.parsers import expat

from urbantwin.errors import InputError

__all__ = ["root_name"]

#: How much of a file is looked at for its first element at a time, bytes.
CHUNK = 65536


class _RootSeen(Exception):  # noqa: N818 - it ends a search and is not an error
    pass


def root_name(stream: IO[bytes], file: Path, expected: str) -> str:
    """Return the local name of the first element; refuse a document type before it.

    Args:
        stream: the XML, from its start.
        file: for errors.
        expected: what the file should be: ``OpenDRIVE``.

    Raises:
        InputError: it is not XML, has no element, or has a document type, which may hold entities.
    """
    found: list[str] = []

    def begin(name: str, _: object) -> None:
        found.append(name.rpartition(":")[2])
        raise _RootSeen

    def doctype(*_: object) -> None:
        raise InputError(
            "has a document type (<!DOCTYPE>), which may hold entities: it is not read",
            file=file,
            expected=f"{expected} without one",
        )

    parser = expat.ParserCreate()
    parser.StartElementHandler = begin
    parser.StartDoctypeDeclHandler = doctype
    try:
        while chunk := stream.read(CHUNK):
            parser.Parse(chunk)
        parser.Parse(b"", True)
    except _RootSeen:
        return found[0]
    except expat.ExpatError as error:
        raise InputError(f"is not XML ({error})", file=file, expected=expected) from None
    except (ValueError, LookupError) as error:
        raise InputError(f"is not XML that can be read ({error})", file=file) from None
    raise InputError("is not XML: it has no element", file=file, expected=expected)
