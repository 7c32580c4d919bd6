"""Check of vector files that GDAL may open safely, without references to other resources.

GDAL detects formats by content, not by name, and some of them (VRT, WFS, GDALG) are instructions to
fetch other resources. It also downloads the CRS that a GeoJSON before RFC 7946 links to.
"""

from __future__ import annotations

import json
import mmap
import re
from pathlib import Path

from urbantwin.errors import InputError

__all__ = ["check_vector_file"]

#: Magic bytes of GeoPackage and SpatiaLite, Shapefile, FlatGeobuf.
_BINARY = (b"SQLite format 3\0", b"\0\0\x27\x0a", b"fgb\x03")
#: Text that every link to a CRS contains, unless its letters are escaped.
_MAY_LINK = re.compile(rb"[\"'](link|url)[\"']|\\u00[4-7]", re.IGNORECASE)


def check_vector_file(path: Path, expected: str) -> None:
    """Raise an error unless a file can be opened without fetching other resources.

    Args:
        path: an existing file.
        expected: the expected format, for error messages.

    Raises:
        InputError: another format, or a CRS given by a link.
    """
    try:
        with path.open("rb") as stream:
            head = stream.read(256)
            if head.startswith(_BINARY):
                return
            if not head.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"{"):
                raise InputError(
                    "cannot be read: its format is another", file=path, expected=expected
                )
            with mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as whole:
                if whole.find(b"gdal_streamed_alg") >= 0:
                    raise InputError(
                        "cannot be read: its format is another", file=path, expected=expected
                    )
                text = bytes(whole) if _MAY_LINK.search(whole) else None
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", file=path) from None
    if text is not None and _links(text):
        raise InputError(
            "names its CRS by a link, which is not followed",
            file=path,
            expected="longitude and latitude (RFC 7946), or a CRS by its name",
        )


def _links(text: bytes) -> bool:
    """Return whether any ``crs`` of a GeoJSON is a link, or may be one."""
    try:
        # Readers differ in which value of a duplicate name they take.
        waiting = [json.loads(text.decode("utf-8-sig"), object_pairs_hook=tuple)]
    except (ValueError, RecursionError):
        return True
    while waiting:
        item = waiting.pop()
        if isinstance(item, list):
            waiting += item
        elif isinstance(item, tuple):
            for name, value in item:
                if name.lower() == "crs" and isinstance(value, tuple):
                    kinds = [str(v).lower() for key, v in value if key.lower() == "type"]
                    if {"link", "url"} & set(kinds):
                        return True
                waiting.append(value)
    return False
