"""A page saved as a single file that works offline."""

from __future__ import annotations

import base64
import gzip
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any, BinaryIO

from urbantwin.artefact import replaced_file
from urbantwin.errors import InputError
from urbantwin.progress import Progress, untold
from urbantwin.web.page_document import saved_html
from urbantwin.web.shown import Shown

__all__ = ["MOST_BYTES", "SavedPage", "write_page"]

#: Largest size without a choice of frames, bytes; frames are included from the first on.
_USUAL_BYTES = 40_000_000
#: Largest size of a page, bytes: browsers hold a page as text, and fail at half a gigabyte.
MOST_BYTES = 400_000_000


@dataclass(frozen=True)
class SavedPage:
    """A saved page.

    Attributes:
        path: the file.
        bytes: its size, bytes.
        frames: number of included frames of the first side.
        left_out: number of frames omitted for the page's size.
        damaged: names of unreadable frames, which the page lists.
    """

    path: Path
    bytes: int
    frames: int
    left_out: int
    damaged: tuple[str, ...]


def write_page(
    shown: Shown,
    path: Path,
    *,
    chosen: bool,
    inputs: Sequence[Path | None] = (),
    tell: Progress = untold,
) -> SavedPage:
    """Write a self-contained page; the same content gives the same bytes.

    Args:
        shown: content of the page.
        path: the ``.html`` to write.
        chosen: whether the user chose the frames; then none is omitted, and a page that is too
            large is an error.
        inputs: input files and folders.
        tell: called with the fraction done and a description.

    Raises:
        InputError: the place cannot be written, or the page would be too large.
    """
    most = MOST_BYTES if chosen else _USUAL_BYTES
    with replaced_file(path, kind="page", inputs=list(inputs)) as file:
        body = file.with_name(f"{file.name}.packets")
        try:
            with body.open("wb") as stream:
                kept = _write_packets(shown, stream, most, chosen, tell)
            document = shown.document()
            total = len(shown.sides[0].entries) if shown.sides else 0
            _cut(document, kept)
            before, behind = saved_html(document)
            size = len(before) + len(behind) + body.stat().st_size
            if size > MOST_BYTES:
                raise _too_large(path, size)
            with file.open("wb") as whole, body.open("rb") as packets:
                whole.write(before)
                while part := packets.read(1 << 20):
                    whole.write(part)
                whole.write(behind)
        finally:
            body.unlink(missing_ok=True)
    damaged = tuple(
        entry.name for side in shown.sides for entry in side.entries if entry.error is not None
    )
    frames = len(document["sides"][0]["frames"]) if document["sides"] else 0
    return SavedPage(path, size, frames, total - frames, damaged)


def _too_large(path: Path, size: float) -> InputError:
    return InputError(
        f"would have {size / 1e6:,.0f} MB or more",
        file=path,
        expected=f"at most {MOST_BYTES / 1e6:,.0f} MB: fewer frames, by --frames or --every",
    )


def _write_packets(
    shown: Shown, stream: BinaryIO, most: int, chosen: bool, tell: Progress
) -> int | None:
    """Write packets; return the number of included time steps, None for all."""
    for name in shown.layers:
        tell(0.0, name)
        stream.write(_tag(name, shown.packet(name)))
    steps = _steps(shown)
    there: set[str] = set()
    for number, step in enumerate(steps):
        tell(number / len(steps), f"frame {number + 1} of {len(steps)}")
        tags = []
        for side, index in step:
            told = shown.document_side(side)
            for kind, has in (("points", "point_packet"), ("boxes", "box_packet")):
                name = f"{kind}/{side}/{index}"
                if not told[has] or name in there:
                    continue
                there.add(name)
                try:
                    tags.append(_tag(name, shown.packet(name)))
                except InputError as error:
                    entry = shown.sides[side].entries[index]
                    entry.error = entry.error or str(error)
        size = stream.tell() + sum(len(one) for one in tags)
        if size > most and number:
            if chosen:
                raise _too_large(Path(shown.title), size / (number + 1) * len(steps))
            return number
        for one in tags:
            stream.write(one)
    return None


def _steps(shown: Shown) -> list[list[tuple[int, int]]]:
    if shown.pairs is not None:
        return [[(0, first), (1, second)] for first, second in shown.pairs]
    return [[(0, index)] for index in range(len(shown.sides[0].entries))] if shown.sides else []


def _cut(document: dict[str, Any], kept: int | None) -> None:
    """Remove entries behind the last included frame from a document."""
    if kept is None:
        return
    ends = [kept]
    if document["pairs"] is not None:
        document["pairs"] = document["pairs"][:kept]
        ends = [max(pair[side] for pair in document["pairs"]) + 1 for side in (0, 1)]
    for side, end in zip(document["sides"], ends, strict=True):
        side["frames"] = side["frames"][:end]
    document["events"] = [one for one in document["events"] if one["frame"] < ends[0]]
    if document["worst"] is not None:
        document["worst"] = [one for one in document["worst"] if one["frame"] < ends[0]]


def _tag(name: str, data: bytes) -> bytes:
    packed = base64.b64encode(gzip.compress(data, 6, mtime=0))
    kind = b'<script type="application/octet-stream" data-packet="'
    return kind + escape(name).encode() + b'">' + packed + b"</script>\n"
