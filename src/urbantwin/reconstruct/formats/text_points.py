"""Points as text: ``.xyz``, ``.pts``, ``.asc``, ``.txt``, ``.csv`` with x y z first."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from urbantwin.errors import InputError
from urbantwin.reconstruct.formats.text_lines import TextLines, text_chunks
from urbantwin.reconstruct.formats.validity import (
    MOST_POINTS,
    check_coordinates,
    content_of,
    count_within,
)
from urbantwin.reconstruct.model import ImportedModel, PointCloud

__all__ = ["read_text_points"]


def read_text_points(path: Path) -> ImportedModel:
    """Read points, a line each: x y z, x y z r g b, or x y z intensity r g b (as PTS has it).

    Numbers are separated by blanks, tabs, commas or semicolons. Lines that start without a
    number, and PTS's counts (a number alone on its line), are passed over.

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
