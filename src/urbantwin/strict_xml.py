"""XML of untrusted files: document types, and with them entities, are rejected before parsing."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO
from xml.parsers import expat

from lxml import etree

from urbantwin.errors import InputError

__all__ = ["child_elements", "root_name"]

#: Bytes read at a time in the search for the first element.
CHUNK = 65536


class _RootSeen(Exception):  # noqa: N818 - it ends a search and is not an error
    pass


def root_name(stream: IO[bytes], file: Path, expected: str) -> str:
    """Return the local name of the first element; reject a document type before it.

    Args:
        stream: the XML, from its start.
        file: file, for errors.
        expected: expected format: ``OpenDRIVE``.

    Raises:
        InputError: not XML, no element, or a document type, which may hold entities.
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


def child_elements(stream: IO[bytes], names: Sequence[str], file: Path) -> Iterator[etree._Element]:
    """Yield the children of the root element, each complete; only one is kept in memory.

    Entities are never expanded, and nothing is fetched. An element is cleared when the next is
    requested.

    Args:
        stream: the XML, from its start.
        names: local names of the elements to yield.
        file: file, for errors.

    Raises:
        InputError: the XML is incomplete or invalid.
    """
    parser = etree.iterparse(
        stream,
        events=("end",),
        tag=[f"{{*}}{name}" for name in names],
        resolve_entities=False,
        no_network=True,
        load_dtd=False,
        remove_comments=True,
        remove_pis=True,
    )
    try:
        for _, item in parser:
            parent = item.getparent()
            if parent is None or parent.getparent() is not None:
                continue  # a nested element
            yield item
            item.clear(keep_tail=False)
            while item.getprevious() is not None:
                del parent[0]
    except etree.XMLSyntaxError as error:
        raise InputError(f"is not complete XML ({error.msg})", file=file) from None
