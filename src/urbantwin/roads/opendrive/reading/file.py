"""Streaming the elements of an untrusted OpenDRIVE file."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from lxml import etree

from urbantwin.errors import InputError
from urbantwin.strict_xml import child_elements, root_name

__all__ = ["top_elements"]

#: The largest file that is read, bytes (26,000 roads in 53 MB take 17 s and 0.4 GB).
LARGEST = 200_000_000
#: The elements that are yielded.
_TOP = ("header", "road", "junction", "controller", "junctionGroup", "station")


def top_elements(path: Path) -> Iterator[etree._Element]:
    """Yield the elements right under ``<OpenDRIVE>``, each whole, names without namespaces.

    Only one element is kept in memory at a time. Document types, and with them every entity, are
    refused before anything is expanded, and nothing is fetched.

    Raises:
        InputError: the file cannot be read, is too large, is not XML or not OpenDRIVE, has a
            document type, or is cut off.
    """
    root = _root_name(path)
    if root != "OpenDRIVE":
        raise InputError(
            f"is not OpenDRIVE: its root is <{root[:40]}>", file=path, expected="<OpenDRIVE>"
        )
    with path.open("rb") as stream:
        for item in child_elements(stream, _TOP, path):
            if "{" in item.tag:
                for element in item.iter("{*}*"):
                    element.tag = etree.QName(element).localname
            yield item


def _root_name(path: Path) -> str:
    """Return the name of the first element, and refuse what comes before it."""
    try:
        size = path.stat().st_size
        if size > LARGEST:
            raise InputError(
                f"is {size / 1e6:.0f} MB large",
                file=path,
                expected=f"{LARGEST / 1e6:.0f} MB or less",
            )
        with path.open("rb") as stream:
            return root_name(stream, path, "OpenDRIVE")
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", file=path) from None
