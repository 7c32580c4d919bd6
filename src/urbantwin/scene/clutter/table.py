"""Tables of what is usual, by group of countries."""

from __future__ import annotations

import csv
from importlib.resources import files

__all__ = ["pairs_of", "rows_of", "tags_of"]


def rows_of(name: str, group: str) -> list[dict[str, str]]:
    """Return the rows of a table that hold for a group: its own before everybody's (``*``)."""
    text = (files(__package__) / name).read_text(encoding="utf-8").splitlines()
    rows = list(csv.DictReader(line for line in text if not line.startswith("#")))
    return [row for own in (group, "*") for row in rows if row["group"] == own]


def tags_of(text: str) -> dict[str, str]:
    """Return the tags that a cell of a table holds."""
    return dict(pairs_of(text))


def pairs_of(text: str) -> list[tuple[str, str]]:
    """Return keys and values of a cell of a table: ``key=value`` by spaces, a key also twice."""
    return [(key, value) for key, _, value in (pair.partition("=") for pair in text.split())]
