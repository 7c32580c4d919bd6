"""Vectorised reading of large text files by line kind, and points in text."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.io.model import ImportedModel, PointCloud
from urbantwin.io.trust import (
    MOST_POINTS,
    check_coordinates,
    content_of,
    count_within,
)
from urbantwin.number_text import leading_numbers

__all__ = ["TextLines", "read_text_points", "text_chunks"]

#: Bytes per chunk.
CHUNK = 1 << 24
#: Longest line, bytes.
LONGEST_LINE = 1 << 26
_NEWLINE, _SPACE = 10, 32
#: A comment after the numbers of a vertex or a face.
_TRAILING = re.compile(rb"^([ \t]*[vf][nt]? [^\n#]*)#[^\n]*", re.MULTILINE)


def text_chunks(path: Path, *, size: int = CHUNK) -> Iterator[tuple[bytes, int]]:
    """Yield pieces of a text file that end with whole lines, and the number of lines before each.

    A backslash at the end of a line joins it to the next (as in OBJ).

    Raises:
        InputError: the file holds zero bytes or a line without an end: it is not text.
    """
    rest, line = b"", 0
    with path.open("rb") as stream:
        while True:
            data = stream.read(size)
            if b"\0" in data:
                raise InputError("is not text", file=path, expected="a text file of that ending")
            piece = rest + data
            end = len(piece)
            if data:
                end = piece.rfind(b"\n") + 1
                while end > 1 and piece[:end].rstrip(b"\r\n").endswith(b"\\"):
                    end = piece.rfind(b"\n", 0, end - 1) + 1
                if end == 0 and len(piece) > LONGEST_LINE:
                    raise InputError("is not text", file=path, expected="lines")
            whole, rest = piece[:end], piece[end:]
            if whole:
                joined = whole.replace(b"\\\r\n", b"   ").replace(b"\\\n", b"  ")
                if b" #" in joined:
                    joined = _TRAILING.sub(rb"\1", joined)
                yield (joined if joined.endswith(b"\n") else joined + b"\n"), line
                line += whole.count(b"\n")
            if not data:
                return


class TextLines:
    """The lines of a piece of text.

    Args:
        data: bytes that end with a newline.
    """

    def __init__(self, data: bytes) -> None:
        self.data = np.frombuffer(data, np.uint8)
        self.ends = np.flatnonzero(self.data == _NEWLINE)
        self.starts = np.concatenate([[0], self.ends[:-1] + 1]).astype(np.int64)
        #: Start of the first word of each line; the line's end if it is empty.
        self.first = self.starts.copy()
        blank = np.flatnonzero((self.data[self.first] <= _SPACE) & (self.first < self.ends))
        while len(blank):
            self.first[blank] += 1
            at = self.first[blank]
            blank = blank[(self.data[at] <= _SPACE) & (at < self.ends[blank])]

    def word_is(self, word: bytes) -> NDArray[np.bool_]:
        """Return for every line whether its first word is ``word``."""
        last = len(self.data) - 1
        found = self.data[self.first] == word[0]
        which = np.flatnonzero(found)  # few lines match: compare the rest of the word only there
        good = self.data[np.minimum(self.first[which] + len(word), last)] <= _SPACE
        for offset, letter in enumerate(word[1:], 1):
            good &= self.data[np.minimum(self.first[which] + offset, last)] == letter
        found[which] = good
        return np.asarray(found)

    def text(self, line: int) -> str:
        """Return a line as text."""
        piece = self.data[self.first[line] : self.ends[line]].tobytes()
        return piece.decode("utf-8", "replace").strip()

    def body(
        self, lines: NDArray[np.bool_] | NDArray[np.int64], skip: int
    ) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
        """Return the bytes of lines after ``skip`` characters, and the start of each."""
        begin, end = self.first[lines] + skip, self.ends[lines] + 1
        length = np.maximum(end - begin, 1)
        begin = end - length
        starts = np.concatenate([[0], np.cumsum(length)[:-1]]).astype(np.int64)
        where = np.repeat(begin - starts, length) + np.arange(int(length.sum()))
        return self.data[where], starts

    def numbers(
        self, lines: NDArray[np.bool_] | NDArray[np.int64], skip: int
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return the numbers of lines after ``skip`` characters, and the count per line.

        Raises:
            ValueError: a word is not a number; the argument is the index among the lines.
        """
        body, starts = self.body(lines, skip)
        if not len(body):
            return np.zeros(0), np.zeros(0, np.int64)
        counts = np.add.reduceat(_token_starts(body).astype(np.int64), starts)
        values = leading_numbers(body.tobytes())
        if len(values) != counts.sum():
            bad = int(np.searchsorted(np.cumsum(counts), len(values), side="right"))
            raise ValueError(min(bad, len(counts) - 1))
        return values, counts


def _token_starts(body: NDArray[np.uint8]) -> NDArray[np.bool_]:
    visible = body > _SPACE
    started = visible.copy()
    started[1:] &= ~visible[:-1]
    return started


def read_text_points(path: Path) -> ImportedModel:
    """Read points, one per line: x y z, x y z r g b, or x y z intensity r g b (as in PTS).

    Numbers are separated by blanks, tabs, commas or semicolons. Lines that start without a number,
    and PTS counts (a single number on a line), are skipped.

    Raises:
        InputError: lines differ in length, or there is none.
    """
    pieces, colours = [], []
    width, total = 0, 0
    for data, before in text_chunks(path):
        lines = TextLines(data.replace(b",", b" ").replace(b";", b" "))
        letter = lines.data[np.minimum(lines.first, len(lines.data) - 1)]
        number = np.isin(letter, np.frombuffer(b"0123456789+-.", np.uint8))
        which = np.flatnonzero(number)
        if not len(which):
            continue
        try:
            values, counts = lines.numbers(which, 0)
        except ValueError as error:
            raise _wrong(lines, before, int(which[int(error.args[0])]), path) from None
        rows = counts >= 3
        width = width or int(counts[rows][0]) if rows.any() else width
        bad = (counts != width) & (counts != 1)
        if bad.any():
            raise _wrong(lines, before, int(which[int(np.argmax(bad))]), path)
        at = (np.cumsum(counts) - counts)[rows]
        table = values[at[:, None] + np.arange(width)] if len(at) else np.zeros((0, max(width, 3)))
        total += len(table)
        count_within(total, MOST_POINTS, "points", path)
        pieces.append(table[:, :3])
        if width in (6, 7, 9):
            first = 4 if width == 7 else 3
            colours.append(table[:, first : first + 3])
    if not total:
        raise InputError("holds no point", file=path, expected="lines of x y z")
    points = np.concatenate(pieces)
    check_coordinates(points, path, "point")
    colour = None
    if colours:
        values = np.concatenate(colours)
        whole = (values >= 0).all() and (values <= 255).all() and (values == values.round()).all()
        colour = values.astype(np.uint8) if whole else None
    cloud = PointCloud(points, colour)
    return ImportedModel(cloud=cloud, notes={"points": len(points)}, files=content_of(path))


def _wrong(lines: TextLines, before: int, line: int, path: Path) -> InputError:
    return InputError(
        f"has {lines.text(line)[:40]!r}",
        file=path,
        place=f"line {before + line + 1}",
        expected="as many numbers as the lines before",
    )
